// SPDX-License-Identifier: Apache-2.0
// Sample elimination of cyCodeBase (Yuksel 2015): sample_elimination CANDIDATES COUNT AREA ORDER OUTPUT.
// CANDIDATES and OUTPUT are files of three doubles a point. ORDER is "none", or "progressive". Prints the CPU
// seconds of the elimination, without the files. Compile it with -I and the folder of cySampleElim.h.
#include <cassert>
#include <cstring>

#include <cySampleElim.h>
#include <cyVector.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>
#include <vector>

typedef cy::Vec3d Point;

static std::vector<Point> read_points(const char *path)
{
    std::ifstream input(path, std::ios::binary | std::ios::ate);
    std::vector<Point> points(static_cast<size_t>(input.tellg()) / sizeof(Point));
    input.seekg(0).read(reinterpret_cast<char *>(points.data()),
                        static_cast<std::streamsize>(points.size() * sizeof(Point)));
    return points;
}

int main(int argc, char **argv)
{
    if (argc != 6) return 2;
    const std::vector<Point> candidates = read_points(argv[1]);
    std::vector<Point> kept(std::strtoul(argv[2], nullptr, 10));
    if (kept.size() >= candidates.size()) return 1;
    cy::WeightedSampleElimination<Point, double, 3> elimination;
    const double reach = 2 * elimination.GetMaxPoissonDiskRadius(2, kept.size(), std::atof(argv[3]));
    const std::clock_t begin = std::clock();
    elimination.Eliminate(candidates.data(), candidates.size(), kept.data(), kept.size(),
                          !std::strcmp(argv[4], "progressive"), reach, 2);
    std::printf("%.6f\n", static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
    std::ofstream output(argv[5], std::ios::binary);
    output.write(reinterpret_cast<const char *>(kept.data()),
                 static_cast<std::streamsize>(kept.size() * sizeof(Point)));
    return output.flush() ? 0 : 1;
}
