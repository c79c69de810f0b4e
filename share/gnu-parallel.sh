#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Frames FIRST to LAST on this machine, or with --sshloginfile on others. A frame with a result is not run again.
#   gnu-parallel.sh SPEC.json OUTPUT FIRST LAST [option of parallel ...]
# parallel runs one frame for each processor, so each has one thread; HEXAD_THREADS changes that. Coherent sequences need -j 1.
spec=$1 output=$2 first=$3 last=$4
shift 4
exec parallel --line-buffer --tag --retries 2 --joblog "$output.log" "$@" env HEXAD_THREADS="${HEXAD_THREADS:-1}" \
    HEXAD_STRICT="${HEXAD_STRICT:-}" hexad-frame "$spec" "$output" '{}' ::: $(seq "$first" "$last")
