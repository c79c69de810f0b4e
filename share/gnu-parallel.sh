#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Frames FIRST to LAST on this machine, or with --sshloginfile on others; again: what is done is not done again.
#   gnu-parallel.sh SPEC.json OUTPUT FIRST LAST [option of parallel ...]
spec=$1 output=$2 first=$3 last=$4
shift 4
exec parallel --line-buffer --tag --retries 2 --joblog "$output.log" "$@" hexad-frame "$spec" "$output" '{}' ::: $(seq "$first" "$last")
