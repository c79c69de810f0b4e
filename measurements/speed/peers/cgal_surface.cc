// SPDX-License-Identifier: Apache-2.0
// CGAL's Surface_mesher, Delaunay refinement of the zero set of a volume: cgal_surface PREFIX COUNT SPACING
// SEED OUTPUT. The arguments and files are those of volume.py; where PREFIX.spacing is there, SPACING is a
// factor to that volume.
#include <CGAL/Surface_mesh_default_triangulation_3.h>
#include <CGAL/Surface_mesher/Standard_criteria.h>
#include <CGAL/Complex_2_in_triangulation_3.h>
#include <CGAL/Implicit_surface_3.h>
#include <CGAL/make_surface_mesh.h>
#include <CGAL/Random.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

typedef CGAL::Surface_mesh_default_triangulation_3 Triangulation;
typedef CGAL::Complex_2_in_triangulation_3<Triangulation> Complex;
typedef Triangulation::Geom_traits Traits;

// The peer's command line: an ideal hexagonal packing of spacing 1 comes out at this bound on the radii.
static const double RADIUS = 0.774, ANGLE = 30;
// Of the surface's size, to which intersections with it are found.
static const double PRECISION = 1e-7;

class Volume {
public:
    Volume(const std::string &prefix, const std::string &suffix)
    {
        std::ifstream head(prefix + ".nhdr");
        std::string line;
        while (std::getline(head, line)) {
            std::replace_if(
                line.begin(), line.end(), [](char c) { return c == '(' || c == ')' || c == ','; }, ' ');
            std::istringstream words(line.substr(line.find(':') + 1));
            if (line.rfind("sizes:", 0) == 0)
                words >> size[0] >> size[1] >> size[2];
            else if (line.rfind("space directions:", 0) == 0)
                words >> voxel;
            else if (line.rfind("space origin:", 0) == 0)
                words >> origin[0] >> origin[1] >> origin[2];
        }
        values.resize(size[0] * size[1] * size[2]);
        std::ifstream raw(prefix + suffix, std::ios::binary);
        if (!raw.read(reinterpret_cast<char *>(values.data()), values.size() * sizeof(float))) values.clear();
    }

    bool empty() const { return values.empty(); }

    // Trilinear; beyond the volume, the value at its edge.
    double at(const Traits::Point_3 &p) const
    {
        size_t corner[3];
        double t[3];
        for (int a = 0; a < 3; a++) {
            double index = std::clamp((p[a] - origin[a]) / voxel, 0.0, size[a] - 1.000001);
            corner[a] = (size_t)index;
            t[a] = index - corner[a];
        }
        double sum = 0;
        for (int k = 0; k < 8; k++) {
            double weight = 1;
            size_t i[3];
            for (int a = 0; a < 3; a++) {
                int upper = k >> a & 1;
                i[a] = corner[a] + upper;
                weight *= upper ? t[a] : 1 - t[a];
            }
            sum += weight * values[i[0] + size[0] * (i[1] + size[1] * i[2])];
        }
        return sum;
    }

    // The bounding sphere about the innermost voxel, since its centre has to be inside.
    Traits::Sphere_3 sphere() const
    {
        size_t least = std::min_element(values.begin(), values.end()) - values.begin();
        size_t i[3] = {least % size[0], least / size[0] % size[1], least / size[0] / size[1]};
        double squared = 0;
        for (int a = 0; a < 3; a++) squared += std::pow(voxel * std::max(i[a], size[a] - i[a]), 2);
        return Traits::Sphere_3(
            Traits::Point_3(origin[0] + voxel * i[0], origin[1] + voxel * i[1], origin[2] + voxel * i[2]),
            squared);
    }

private:
    std::array<size_t, 3> size{};
    std::array<double, 3> origin{};
    double voxel = 0;
    std::vector<float> values;
};

// The radius of a facet's ball against the spacing that is asked for at its centre.
class Size_criterion : public CGAL::Surface_mesher::Refine_criterion<Triangulation> {
public:
    Size_criterion(const Volume &relative, double spacing) : relative(relative), spacing(spacing) {}

    bool is_bad(const Triangulation::Facet &facet, double &quality) const override
    {
        const auto &centre = facet.first->get_facet_surface_center(facet.second);
        const auto &corner = facet.first->vertex((facet.second + 1) & 3)->point();
        double bound = RADIUS * spacing * (relative.empty() ? 1 : relative.at(centre));
        quality = bound * bound / CGAL::squared_distance(corner, centre);
        return quality < 1;
    }

private:
    const Volume &relative;
    double spacing;
};

int main(int argc, char **argv)
{
    if (argc != 6) return 2;
    CGAL::get_default_random() = CGAL::Random(std::stoul(argv[4]));
    const std::string prefix = argv[1];
    const Volume volume(prefix, ".raw"), relative(prefix, ".spacing");
    auto value = [&](const Traits::Point_3 &p) { return volume.at(p); };
    CGAL::Implicit_surface_3<Traits, decltype(value)> surface(value, volume.sphere(), PRECISION);

    typedef CGAL::Surface_mesher::Refine_criterion<Triangulation> Criterion;
    CGAL::Surface_mesher::Aspect_ratio_criterion<Triangulation> angles(ANGLE);
    Size_criterion sizes(relative, std::stod(argv[3]));
    CGAL::Surface_mesher::Standard_criteria<Criterion> criteria({&angles, &sizes});

    Triangulation triangulation;
    Complex complex(triangulation);
    CGAL::make_surface_mesh(complex, surface, criteria, CGAL::Non_manifold_tag());

    std::ofstream output(argv[5], std::ios::binary);
    for (auto v = triangulation.finite_vertices_begin(); v != triangulation.finite_vertices_end(); ++v) {
        const double place[3] = {v->point().x(), v->point().y(), v->point().z()};
        output.write(reinterpret_cast<const char *>(place), sizeof place);
    }
    return output.flush() ? 0 : 1;
}
