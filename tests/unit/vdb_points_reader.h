// SPDX-License-Identifier: Apache-2.0
/* vdb_points_reader: compares an OpenVDB file with the points that were written. */
#ifndef HEXAD_TESTS_VDB_POINTS_READER_H
#define HEXAD_TESTS_VDB_POINTS_READER_H

#include "io/vdb/vdb.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Reads a file from its beginning. Error: internal (it differs; the message has the point and the
 * attribute). */
bool vdb_points_compare(int fd, const vdb_points *points, error *e);

#ifdef __cplusplus
}
#endif

#endif
