#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# One task of a Slurm array for each frame, without hexad's queue:
#   sbatch --array=1-100 --cpus-per-task=4 --mem=4096 slurm-array.sh SPEC.json OUTPUT
# A frame with a result is not run again. Slurm's SIGTERM reaches the worker. Coherent sequences need --array=1-100%1.
#SBATCH --job-name=hexad
#SBATCH --output=hexad-%A_%a.log
export HEXAD_THREADS="${HEXAD_THREADS:-${SLURM_CPUS_PER_TASK:-}}"
exec hexad-frame "$1" "$2" "$SLURM_ARRAY_TASK_ID"
