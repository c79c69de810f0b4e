#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Submits frames to OpenCue: opencue.py SPEC.json OUTPUT FRAMES, say 1-100. Needs pyoutline; the hosts need hexad-frame."""
import sys

import outline
import outline.cuerun
from outline.modules.shell import Shell

if len(sys.argv) != 4:
    sys.exit(__doc__)
spec, output, frames = sys.argv[1:]
job = outline.Outline("hexad", frame_range=frames)
job.add_layer(Shell("sample", command=["hexad-frame", spec, output, "#IFRAME#", "opencue"], range=frames, chunk=1))
outline.cuerun.launch(job, use_pycuerun=False)
