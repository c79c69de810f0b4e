#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# ACVD with the subdivision that its authors give for high quality: acvd_fine.sh PREFIX COUNT SPACING SEED OUTPUT. It takes gigabytes.
RATIO=100 exec sh "$(dirname "$0")/acvd.sh" "$@"
