// SPDX-License-Identifier: Apache-2.0
// CGAL's isotropic remeshing of triangles: cgal_remesh PREFIX COUNT SPACING SEED OUTPUT, as in volume.py. It
// draws nothing at random, so that the seed is of no consequence.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/remesh.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh/IO/PLY.h>

#include <fstream>
#include <string>

typedef CGAL::Exact_predicates_inexact_constructions_kernel Kernel;
typedef CGAL::Surface_mesh<Kernel::Point_3> Mesh;

// The peer's command line: an ideal hexagonal packing of spacing 1 comes out at this target for the edges.
static const double EDGE = 1.094;
static const unsigned ITERATIONS = 10;

int main(int argc, char **argv)
{
    if (argc != 6) return 2;
    Mesh mesh;
    std::ifstream input(std::string(argv[1]) + ".ply", std::ios::binary);
    if (!CGAL::IO::read_PLY(input, mesh)) return 1;
    CGAL::Polygon_mesh_processing::isotropic_remeshing(
        faces(mesh), EDGE * std::stod(argv[3]), mesh,
        CGAL::Polygon_mesh_processing::parameters::number_of_iterations(ITERATIONS));
    std::ofstream output(argv[5], std::ios::binary);
    for (auto v : mesh.vertices()) {
        const Kernel::Point_3 &p = mesh.point(v);
        const double place[3] = {p.x(), p.y(), p.z()};
        output.write(reinterpret_cast<const char *>(place), sizeof place);
    }
    return output.flush() ? 0 : 1;
}
