#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Teem's pull, on the volume: teem_puller.sh PREFIX COUNT SPACING SEED OUTPUT (a NRRD, 4 by the count)
# A few of the points that it starts with never come to the surface, hence 1.07 of them.
set -eu
prefix=$1 count=$2 spacing=$3 seed=$4 output=$5
exec teem-puller -vol "$prefix.nhdr:scalar:V" -int justr -enr cotan \
    -info iso-c:V:val:0:1 isogvec:V:gvec isohess:V:hess -k00 ctmr -k11 ctmrd -k22 ctmrdd \
    -np "$(awk "BEGIN { printf \"%d\", 1.07 * $count }")" -irad "$(awk "BEGIN { print 2.03 * $spacing }")" \
    -pcp 0 -maxi 300 -edmin 1e-5 -nt 1 -rng "$seed" -v 0 -o "$output"
