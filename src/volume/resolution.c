#include "volume/resolution.h"

#include <math.h>

#include "geometry/bbox.h"
#include "packing/packing.h"

/* Voxels along the longest side that show a scanned mesh: nine tenths of it lie within 0.05 voxel. */
static const double usual_resolution = 256;
/* What the surface takes at the peak while it is opened, for each square voxel of the mesh: measured at 350 to 450
 * bytes between 256 and 2048 voxels, thin sheets at less. */
static const double bytes_per_square = 450;
/* Shares of the memory: of what the points leave, for voxels as small as the spacing; of all, for thin parts, which
 * cost time that has nothing to do with the number of points. */
static const double share_for_spacing = 0.5, share_for_thickness = 0.125;
/* A step of voxels that took too much memory. */
static const double relenting = 1.4;
/* Gains below this are not worth another try. */
static const double least_gain = 0.95;

/* The smallest voxels within the bounds, and which bound that is. */
static double finest_voxel(const resolution *r, const resolution_request *q, double bytes, const char **bound)
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

resolution resolution_begin(const mesh *m, const resolution_request *q)
{
    resolution r = {.area = mesh_area(m), .chosen_by = "spec"};
    r.longest = m->triangle_count ? bbox_longest(mesh_box(m, NULL)) : 0;
    r.spacing = q->spacing > 0 ? q->spacing : q->count > 0 ? packing_spacing(r.area, q->count) : 0;
    r.voxel_size = q->voxel_size > 0 ? q->voxel_size : r.longest / q->resolution;
    if (q->voxel_size > 0 || q->resolution > 0) return r;
    const double usual = fmax(r.longest / usual_resolution, q->least), limit = (double)q->memory_limit;
    const char *bound;
    r.finest = finest_voxel(&r, q, share_for_thickness * limit, &bound);
    r.voxel_size = usual;
    r.chosen_by = "default";
    if (!(r.spacing > 0 && r.spacing < usual)) return r;
    const double points = packing_count(r.area, r.spacing) * q->point_bytes;
    const double least = finest_voxel(&r, q, share_for_spacing * (limit - points), &bound);
    r.voxel_size = fmin(usual, fmax(r.spacing, least));
    r.chosen_by = r.voxel_size < usual ? "spacing" : "default";
    if (least > r.spacing) r.limited_by = bound;
    return r;
}

bool resolution_refine(resolution *r, const resolution_request *q, double all, double worth)
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

void resolution_relent(resolution *r, double enough)
{
    r->voxel_size = fmin(enough, r->voxel_size * relenting);
    r->limited_by = "memory";
}
