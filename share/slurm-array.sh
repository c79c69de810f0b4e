#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# One task of a Slurm array for each frame, without hexad's queue:
#   sbatch --array=1-100 --cpus-per-task=4 --mem=4096 slurm-array.sh SPEC.json OUTPUT
# A task that Slurm runs again does not compute a frame again whose result is there. Slurm's SIGTERM reaches the worker.
#SBATCH --job-name=hexad
#SBATCH --output=hexad-%A_%a.log
exec hexad-frame "$1" "$2" "$SLURM_ARRAY_TASK_ID"
