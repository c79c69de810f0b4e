// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/voxel_size.h"

#include <math.h>

#include "geometry/space/bbox.h"
#include "geometry/space/packing.h"

/* Default voxels along the longest side: with these, nine tenths of a scanned mesh are within 0.05 voxels of
 * the level set. */
static const double usual_resolution = 256;
/* Minimum of default voxels along the longest side, however few the points. Fewer save no time: a combination
 * has at least 96 cells along its longest side. */
static const double fewest_resolution = 80;
/* Peak memory during opening, in bytes per square voxel of the mesh's area. Measured: 350 to 450 for 256 to
 * 2048 voxels along the longest side; less for thin walls. */
static const double bytes_per_square = 450;
/* Fractions of memory: for voxels as small as the spacing, of the memory that the points leave; for thin
 * parts, of all memory, since their cost does not depend on the number of points. */
static const double share_for_spacing = 0.5, share_for_thickness = 0.125;
/* Factor of the voxel size after it exceeded the memory. */
static const double coarsening = 1.4;
/* Maximum ratio of voxel sizes for another attempt. */
static const double least_gain = 0.95;

/* The minimum voxel size, and the name of the bound that determines it. */
static double finest_voxel(const resolution *r, const voxel_size_request *q, double bytes, const char **bound)
{
    double size = r->longest / q->max_resolution, fitting = sqrt(bytes_per_square * r->area / fmax(bytes, 1));
    *bound = "max_resolution";
    if (fitting > size) {
        size = fitting;
        *bound = "memory";
    }
    if (q->least > size) {
        size = q->least;
        *bound = "band";
    }
    return size;
}

resolution voxel_size_begin(const mesh *m, const voxel_size_request *q)
{
    resolution r = {.area = mesh_area(m), .chosen_by = "spec"};
    r.longest = m->triangle_count ? bbox_longest(mesh_box(m, NULL)) : 0;
    r.spacing = q->spacing > 0 ? q->spacing : q->count > 0 ? packing_spacing(r.area, q->count) : 0;
    r.voxel_size = q->voxel_size > 0 ? q->voxel_size : r.longest / q->resolution;
    if (q->voxel_size > 0 || q->resolution > 0) return r;
    const double enough =
                     q->per_spacing > 0 ? fmin(r.spacing / q->per_spacing, r.longest / fewest_resolution) : 0,
                 usual = fmax(fmax(r.longest / usual_resolution, enough), q->least),
                 limit = (double)q->memory_limit;
    const char *bound;
    r.finest = finest_voxel(&r, q, share_for_thickness * limit, &bound);
    r.voxel_size = usual;
    r.chosen_by = enough > r.longest / usual_resolution && enough >= q->least ? "spacing" : "default";
    if (!(r.spacing > 0 && r.spacing < usual)) return r;
    const double points = packing_count(r.area, r.spacing) * q->point_bytes;
    const double least = finest_voxel(&r, q, share_for_spacing * (limit - points), &bound);
    r.voxel_size = fmin(usual, fmax(r.spacing, least));
    if (r.voxel_size < usual) r.chosen_by = "spacing";
    if (least > r.spacing) r.limited_by = bound;
    return r;
}

bool voxel_size_refine(resolution *r, const voxel_size_request *q, double all, double worth)
{
    const char *bound;
    if (!(r->finest > 0)) return false;
    if (all < r->finest) {
        finest_voxel(r, q, share_for_thickness * (double)q->memory_limit, &bound);
        r->limited_by = bound;
    }
    const double wanted = fmax(worth, r->finest);
    if (!(wanted < least_gain * r->voxel_size)) return false;
    r->voxel_size = wanted;
    r->chosen_by = "thickness";
    return true;
}

void voxel_size_coarsen(resolution *r, double enough)
{
    r->voxel_size = fmin(enough, r->voxel_size * coarsening);
    r->limited_by = "memory";
}
