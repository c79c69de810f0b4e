#!/bin/sh
# MeshLab's Poisson-disk sampling of triangles: meshlab_poisson.sh PREFIX COUNT SPACING SEED OUTPUT (a PLY)
# The program has no way to be given a seed. It wants a display's platform, if not a display.
set -eu
prefix=$1 count=$2 output=$5
script=$output.mlx
trap 'rm -f "$script"' EXIT
cat >"$script" <<END
<!DOCTYPE FilterScript>
<FilterScript>
 <filter name="Poisson-disk Sampling">
  <Param type="RichInt" name="SampleNum" value="$count"/>
  <Param type="RichAbsPerc" name="Radius" value="0" min="0" max="1000"/>
  <Param type="RichInt" name="MontecarloRate" value="20"/>
  <Param type="RichBool" name="ExactNumFlag" value="true"/>
  <Param type="RichFloat" name="ExactNumTolerance" value="0.005"/>
 </filter>
</FilterScript>
END
QT_QPA_PLATFORM=offscreen meshlabserver -i "$prefix.ply" -s "$script" -o "$output" >/dev/null 2>&1
