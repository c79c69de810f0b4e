#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Geogram's centroidal Voronoi tessellation of triangles: geogram_cvt.sh PREFIX COUNT SPACING SEED OUTPUT (a PLY).
# HEXAD_GEOGRAM: the executable vorpalite. Five iterations of Lloyd and 30 of a quasi-Newton method are its defaults. Points are the centroids of
# the restricted Voronoi cells. multi_nerve would add points where a cell has several parts.
set -eu
prefix=$1 count=$2 seed=$4 output=$5
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$HEXAD_GEOGRAM" "$prefix.ply" "$work/points.ply" profile=scan remesh:nb_pts="$count" opt:nb_Lloyd_iter=5 opt:nb_Newton_iter=30 \
    remesh:multi_nerve=false post=false algo:random_seed="$seed" sys:multithread=false algo:parallel=false >/dev/null
mv "$work/points.ply" "$output"
