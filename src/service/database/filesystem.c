// SPDX-License-Identifier: Apache-2.0
#include "service/database/filesystem.h"

#include <errno.h>
#include <stddef.h>
#include <string.h>
#include <sys/vfs.h>

const char *filesystem_network_name(uint64_t type)
{
    /* some are in linux/magic.h, the others in the sources of their projects */
    static const struct {
        uint32_t type;
        const char *name;
    } known[] = {
        {0x00006969, "NFS"},    {0x0000517B, "SMB"},  {0xFF534D42, "CIFS"},     {0xFE534D42, "SMB"},
        {0x5346414F, "AFS"},    {0x6B414653, "AFS"},  {0x00C36400, "CephFS"},   {0x01021997, "9P"},
        {0x0BD00BD0, "Lustre"}, {0x47504653, "GPFS"}, {0x19830326, "BeeGFS"},   {0xAAD7AAEA, "PanFS"},
        {0x7461636F, "OCFS2"},  {0x01161970, "GFS2"}, {0x20030528, "OrangeFS"}, {0x73757245, "Coda"},
    };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (known[i].type == (uint32_t)type) return known[i].name;
    return NULL;
}

bool filesystem_check(const char *directory, error *e)
{
    struct statfs info;
    if (statfs(directory, &info) != 0)
        return error_set(e, ERROR_INTERNAL, "%s: %s", directory, strerror(errno));
    const char *name = filesystem_network_name((uint64_t)info.f_type);
    return !name ||
           error_set(e, ERROR_INTERNAL,
                     "the state directory %s is on a network file system (%s), which does not protect a "
                     "queue against loss: set state_dir to a directory of a local disk",
                     directory, name);
}
