#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# MeshLab's Poisson-disk sampling of triangles: meshlab_poisson.sh PREFIX COUNT SPACING SEED OUTPUT (a PLY)
# It has no way to be given a seed, and wants a display with OpenGL, hence xvfb-run, even to run a script; all
# parameters of a filter have to be there, in this order.
set -eu
prefix=$1 count=$2 output=$5
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/script.mlx" <<END
<!DOCTYPE FilterScript>
<FilterScript>
 <filter name="Poisson-disk Sampling">
  <Param type="RichInt" name="SampleNum" value="$count"/>
  <Param type="RichAbsPerc" name="Radius" value="0" min="0" max="1000"/>
  <Param type="RichInt" name="MontecarloRate" value="20"/>
  <Param type="RichBool" name="SaveMontecarlo" value="false"/>
  <Param type="RichBool" name="ApproximateGeodesicDistance" value="false"/>
  <Param type="RichBool" name="Subsample" value="false"/>
  <Param type="RichBool" name="RefineFlag" value="false"/>
  <Param type="RichMesh" name="RefineMesh" value="0"/>
  <Param type="RichBool" name="BestSampleFlag" value="true"/>
  <Param type="RichInt" name="BestSamplePool" value="10"/>
  <Param type="RichBool" name="ExactNumFlag" value="true"/>
  <Param type="RichFloat" name="RadiusVariance" value="1"/>
 </filter>
</FilterScript>
END
xvfb-run -a meshlabserver -i "$prefix.ply" -s "$work/script.mlx" -o "$work/points.ply" >/dev/null 2>&1
mv "$work/points.ply" "$output"
