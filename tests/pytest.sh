#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Runs one pytest file and speaks TAP on standard output (tests/conftest.py writes it to descriptor 3);
# pytest's own report goes to standard error.
if [ -z "$PYTHON" ]; then
    echo "1..0 # SKIP no Python with numpy, scipy and pytest"
    exit 0
fi
exec 3>&1 1>&2
HEXAD_TAP_FD=3
export HEXAD_TAP_FD
exec "$PYTHON" -m pytest -p no:cacheprovider --tb=short -q "$@"
