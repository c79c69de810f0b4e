#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# ACVD's uniform clustering of triangles: acvd.sh PREFIX COUNT SPACING SEED OUTPUT (a PLY). HEXAD_ACVD: the executable ACVD.
# It has no option for a seed. Points are the centres of the clusters: -q 0 leaves out the placement by quadrics, which is for sharp features.
# It subdivides the triangles until they have RATIO times as many vertices as clusters; its default is 10.
set -eu
prefix=$1 count=$2 output=$5
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$HEXAD_ACVD" "$prefix.ply" "$count" 0 -s "${RATIO:-10}" -q 0 -o "$work" -of points.ply >/dev/null
mv "$work/points.ply" "$output"
