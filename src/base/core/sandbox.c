// SPDX-License-Identifier: Apache-2.0
#include "base/core/sandbox.h"

#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <fcntl.h>
#include <link.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <seccomp.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "base/core/memory.h"

#if defined __SANITIZE_ADDRESS__ || defined __SANITIZE_THREAD__
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

static const char *const mode_names[] = {SANDBOX_LIST(WORDS_TEXT, )};

bool sandbox_mode_from_name(const char *name, sandbox_mode *mode)
{
    for (size_t i = 0; i < SANDBOX_MODES; i++) {
        if (strcmp(mode_names[i], name) == 0) {
            *mode = (sandbox_mode)i;
            return true;
        }
    }
    return false;
}

const char *sandbox_mode_name(sandbox_mode mode)
{
    return mode_names[mode];
}

/* ---- Landlock. Headers may be older than the kernel: constants after version 2 are defined here. */

typedef struct ruleset {
    uint64_t files, net, scope; /* struct landlock_ruleset_attr as of version 6 */
} ruleset;

#define FILES_TRUNCATE (1ull << 14)  /* version 3 */
#define FILES_IOCTL_DEV (1ull << 15) /* version 5 */
#define NET_TCP 3ull                 /* version 4: bind and connect */
#define SCOPE_ALL 3ull               /* version 6: abstract sockets of, and signals to, processes outside */

static const uint64_t files_of_version_1 = (1ull << 13) - 1;
static const uint64_t read_file = LANDLOCK_ACCESS_FS_READ_FILE;
static const uint64_t run_file = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_EXECUTE;
static const uint64_t read_directory = LANDLOCK_ACCESS_FS_READ_DIR;
static const uint64_t write_file = LANDLOCK_ACCESS_FS_WRITE_FILE;
static const uint64_t keep_files = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_WRITE_FILE |
                                   LANDLOCK_ACCESS_FS_READ_DIR | LANDLOCK_ACCESS_FS_MAKE_REG |
                                   LANDLOCK_ACCESS_FS_REMOVE_FILE | FILES_TRUNCATE;

/* Version of the kernel; 0: Landlock is missing or disabled. */
static int landlock_version(void)
{
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    return version > 0 ? (int)version : 0;
}

static ruleset handled_by(int version)
{
    ruleset r = {.files = files_of_version_1};
    if (version >= 2) r.files |= LANDLOCK_ACCESS_FS_REFER;
    if (version >= 3) r.files |= FILES_TRUNCATE;
    if (version >= 4) r.net = NET_TCP;
    if (version >= 5) r.files |= FILES_IOCTL_DEV;
    if (version >= 6) r.scope = SCOPE_ALL;
    return r;
}

static size_t ruleset_size(int version)
{
    return version >= 6 ? sizeof(ruleset) : version >= 4 ? offsetof(ruleset, scope) : offsetof(ruleset, net);
}

/* Grants rights below a path. A missing place needs no rule, unless it must exist. */
static bool grant(int rules, uint64_t handled, const char *path, uint64_t rights, bool must, error *e)
{
    struct landlock_path_beneath_attr beneath = {.allowed_access = rights & handled};
    beneath.parent_fd = open(path, O_PATH | O_CLOEXEC);
    bool ok = beneath.parent_fd >= 0
                  ? syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &beneath, 0) == 0
                  : !must;
    int why = errno;
    if (beneath.parent_fd >= 0) close(beneath.parent_fd);
    return ok || error_set(e, ERROR_INTERNAL, "sandbox: no rule for %s: %s", path, strerror(why));
}

/* The loader of this program; "" if it is linked statically. */
static int find_loader(struct dl_phdr_info *info, size_t size, void *path)
{
    (void)size;
    for (int i = 0; i < info->dlpi_phnum; i++)
        if (info->dlpi_phdr[i].p_type == PT_INTERP)
            *(const char **)path = (const char *)(info->dlpi_addr + info->dlpi_phdr[i].p_vaddr);
    return 1; /* the program comes first; libraries may have a loader, too */
}

/* Grants the directories that the loader searches: the default ones, those of the program's run path, and
 * those of its cache. */
static bool grant_libraries(int rules, uint64_t handled, error *e)
{
    static const char *const usual[] = {"/lib",       "/lib64",         "/usr/lib",
                                        "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache"};
    bool ok = true;
    for (size_t i = 0; ok && i < sizeof usual / sizeof *usual; i++)
        ok = grant(rules, handled, usual[i], read_file, false, e);
    void *program = dlopen(NULL, RTLD_LAZY);
    Dl_serinfo size = {0};
    if (!program || dlinfo(program, RTLD_DI_SERINFOSIZE, &size) != 0) return ok;
    Dl_serinfo *paths = mem_alloc(size.dls_size);
    *paths = size;
    if (dlinfo(program, RTLD_DI_SERINFO, paths) == 0)
        for (unsigned i = 0; ok && i < paths->dls_cnt; i++)
            ok = grant(rules, handled, paths->dls_serpath[i].dls_name, read_file, false, e);
    free(paths);
    dlclose(program);
    return ok;
}

static bool add_rules(int rules, uint64_t handled, const sandbox_places *places, error *e)
{
    const char *loader = "";
    dl_iterate_phdr(find_loader, &loader);
    bool ok = grant(rules, handled, "/proc/self/exe", run_file, true, e) &&
              (!*loader || grant(rules, handled, loader, run_file, true, e)) &&
              grant_libraries(rules, handled, e) &&
              grant(rules, handled, "/dev/null", write_file, false, e) &&
              grant(rules, handled, SANDBOX_OWN_STATUS, read_file, false, e) &&
              (!places->writable || grant(rules, handled, places->writable, keep_files, true, e));
    for (size_t i = 0; ok && i < places->readable_count; i++)
        ok = grant(rules, handled, places->readable[i], read_file, true, e);
    /* the runtimes of sanitizers read it */
    if (ok && SANITIZED) ok = grant(rules, handled, "/proc", read_file | read_directory, false, e);
    return ok;
}

static bool enter_landlock(int version, const sandbox_places *places, error *e)
{
    ruleset handled = handled_by(version);
    int rules = (int)syscall(SYS_landlock_create_ruleset, &handled, ruleset_size(version), 0);
    if (rules < 0) return error_set(e, ERROR_INTERNAL, "sandbox: no Landlock rules: %s", strerror(errno));
    bool ok = add_rules(rules, handled.files, places, e) &&
              (syscall(SYS_landlock_restrict_self, rules, 0) == 0 ||
               error_set(e, ERROR_INTERNAL, "sandbox: Landlock: %s", strerror(errno)));
    close(rules);
    return ok;
}

/* ---- the filter */

/* System calls of a worker and of the process that reads meshes: glibc, the loader, OpenVDB, assimp, and
 * fallbacks of glibc. A filter cannot follow pointers: Landlock restricts paths. */
// clang-format off
static const int calls[] = {
    /* memory */
    SCMP_SYS(brk), SCMP_SYS(mmap), SCMP_SYS(mmap2), SCMP_SYS(munmap), SCMP_SYS(mremap), SCMP_SYS(mprotect),
    SCMP_SYS(madvise), SCMP_SYS(membarrier),
    /* files */
    SCMP_SYS(open), SCMP_SYS(openat), SCMP_SYS(openat2), SCMP_SYS(close), SCMP_SYS(close_range),
    SCMP_SYS(read), SCMP_SYS(readv), SCMP_SYS(pread64), SCMP_SYS(write), SCMP_SYS(writev), SCMP_SYS(pwrite64),
    SCMP_SYS(lseek), SCMP_SYS(_llseek), SCMP_SYS(fstat), SCMP_SYS(fstat64), SCMP_SYS(stat), SCMP_SYS(lstat),
    SCMP_SYS(newfstatat), SCMP_SYS(fstatat64), SCMP_SYS(statx), SCMP_SYS(access), SCMP_SYS(faccessat),
    SCMP_SYS(faccessat2), SCMP_SYS(readlink), SCMP_SYS(readlinkat), SCMP_SYS(getcwd), SCMP_SYS(getdents64),
    SCMP_SYS(dup), SCMP_SYS(dup2), SCMP_SYS(dup3), SCMP_SYS(fsync), SCMP_SYS(fdatasync), SCMP_SYS(ftruncate),
    SCMP_SYS(unlink), SCMP_SYS(unlinkat), SCMP_SYS(rename), SCMP_SYS(renameat), SCMP_SYS(renameat2),
    SCMP_SYS(mkdir), SCMP_SYS(mkdirat), SCMP_SYS(pipe2), SCMP_SYS(sync_file_range), SCMP_SYS(sync_file_range2),
    SCMP_SYS(poll), SCMP_SYS(ppoll), SCMP_SYS(fadvise64), SCMP_SYS(sendmsg), SCMP_SYS(recvmsg),
    /* threads, and the process that reads meshes */
    SCMP_SYS(futex), SCMP_SYS(futex_time64), SCMP_SYS(set_robust_list), SCMP_SYS(set_tid_address),
    SCMP_SYS(rseq), SCMP_SYS(arch_prctl), SCMP_SYS(sched_yield), SCMP_SYS(sched_getaffinity),
    SCMP_SYS(getpid), SCMP_SYS(gettid), SCMP_SYS(getppid), SCMP_SYS(execve), SCMP_SYS(wait4),
    SCMP_SYS(waitid), SCMP_SYS(exit), SCMP_SYS(exit_group), SCMP_SYS(restart_syscall),
    /* signals; none sends one, since a reader has the same filter, but other process numbers */
    SCMP_SYS(rt_sigaction), SCMP_SYS(rt_sigprocmask), SCMP_SYS(rt_sigreturn), SCMP_SYS(sigreturn),
    SCMP_SYS(sigaltstack),
    /* time */
    SCMP_SYS(clock_gettime), SCMP_SYS(clock_gettime64), SCMP_SYS(clock_nanosleep),
    SCMP_SYS(clock_nanosleep_time64), SCMP_SYS(gettimeofday), SCMP_SYS(setitimer),
    /* limits and system information */
    SCMP_SYS(getrlimit), SCMP_SYS(ugetrlimit), SCMP_SYS(setrlimit), SCMP_SYS(getrusage), SCMP_SYS(sysinfo),
    SCMP_SYS(uname), SCMP_SYS(getrandom), SCMP_SYS(getuid), SCMP_SYS(geteuid), SCMP_SYS(getgid),
    SCMP_SYS(getegid),
#if SANITIZED
    SCMP_SYS(prctl), SCMP_SYS(personality), SCMP_SYS(getdents), SCMP_SYS(kill), SCMP_SYS(tgkill),
    SCMP_SYS(tkill),
#endif
};

/* Commands of fcntl. With F_SETOWN, F_SETSIG and O_ASYNC the kernel sends any signal to any process of the user.
 * Locks and leases delay processes that use the file. */
static const int fcntl_commands[] = {F_DUPFD, F_DUPFD_CLOEXEC, F_GETFD, F_SETFD, F_GETFL};
// clang-format on

static int add_fcntl(scmp_filter_ctx filter, int call)
{
    int why = 0;
    for (size_t i = 0; why == 0 && i < sizeof fcntl_commands / sizeof *fcntl_commands; i++) {
        const struct scmp_arg_cmp command = SCMP_A1(SCMP_CMP_EQ, (scmp_datum_t)fcntl_commands[i]);
        why = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, call, 1, &command);
    }
    return why;
}

/* System calls whose arguments are checked. clone may make threads and what posix_spawn needs, but no
 * namespace, no copy of the process and no child of its parent. clone3 is refused, since its flags are behind a
 * pointer; glibc falls back to clone. Limits: own process only. socketpair: only streams, which pass descriptors
 * to a reader; datagram sockets could send to any other socket. */
static int add_checked_calls(scmp_filter_ctx filter)
{
    const uint64_t refused = CLONE_NEWNS | CLONE_NEWCGROUP | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWUSER |
                             CLONE_NEWPID | CLONE_NEWNET | CLONE_PARENT;
    const struct scmp_arg_cmp shares = SCMP_A0(SCMP_CMP_MASKED_EQ, refused | CLONE_VM, CLONE_VM);
    const struct scmp_arg_cmp own = SCMP_A0(SCMP_CMP_EQ, 0);
    const struct scmp_arg_cmp dies = SCMP_A0(SCMP_CMP_EQ, PR_SET_PDEATHSIG);
    const struct scmp_arg_cmp name = SCMP_A0(SCMP_CMP_EQ, PR_SET_NAME);
    const struct scmp_arg_cmp pair[] = {SCMP_A0(SCMP_CMP_EQ, AF_UNIX),
                                        SCMP_A1(SCMP_CMP_EQ, SOCK_STREAM | SOCK_CLOEXEC)};
    int why = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, SCMP_SYS(clone), 1, &shares);
    if (why == 0) why = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, SCMP_SYS(prlimit64), 1, &own);
    if (why == 0) why = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, SCMP_SYS(socketpair), 2, pair);
    if (why == 0) why = add_fcntl(filter, SCMP_SYS(fcntl));
    if (why == 0) why = add_fcntl(filter, SCMP_SYS(fcntl64));
    if (SANITIZED) return why; /* prctl is in the table then */
    if (why == 0) why = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, SCMP_SYS(prctl), 1, &dies);
    if (why == 0) why = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, SCMP_SYS(prctl), 1, &name);
    return why;
}

static bool has_filters(void)
{
    uint32_t action = SECCOMP_RET_ERRNO;
    return syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0;
}

static bool enter_filter(error *e)
{
    /* not EPERM: with ENOSYS libc assumes an older kernel and falls back */
    scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ERRNO(ENOSYS));
    int why = filter ? seccomp_attr_set(filter, SCMP_FLTATR_CTL_OPTIMIZE, 2) : -ENOMEM;
    for (size_t i = 0; why == 0 && i < sizeof calls / sizeof *calls; i++)
        why = seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, calls[i], 0, NULL);
    if (why == 0) why = add_checked_calls(filter);
    if (why == 0) why = seccomp_load(filter);
    seccomp_release(filter);
    return why == 0 || error_set(e, ERROR_INTERNAL, "sandbox: no filter of system calls: %s", strerror(-why));
}

/* ---- entry */

#ifdef __SANITIZE_ADDRESS__
/* Called by the runtime at exit: leak detection needs a process that traces this one, which the filter
 * refuses. Workers outside a sandbox detect leaks. */
__attribute__((visibility("default"))) int __lsan_is_turned_off(void);
int __lsan_is_turned_off(void)
{
    return prctl(PR_GET_SECCOMP) == 2;
}
#endif

bool sandbox_check(sandbox_mode mode, error *e)
{
    if (mode != SANDBOX_REQUIRED) return true;
    if (!has_filters())
        return error_set(e, ERROR_INTERNAL,
                         "sandbox: this kernel has no seccomp filters; set sandbox to \"available\" to run "
                         "without them");
    return landlock_version() > 0 ||
           error_set(e, ERROR_INTERNAL,
                     "sandbox: this kernel has no Landlock, or its parameter lsm= does not list it; set "
                     "sandbox to \"available\" to run without it");
}

bool sandbox_enter(sandbox_mode mode, const sandbox_places *places, error *e)
{
    if (mode == SANDBOX_OFF) return true;
    int version = landlock_version();
    if (!sandbox_check(mode, e)) return false;
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0)
        return error_set(e, ERROR_INTERNAL, "sandbox: no_new_privs: %s", strerror(errno));
    return (version == 0 || enter_landlock(version, places, e)) && (!has_filters() || enter_filter(e));
}

const char *sandbox_describe(sandbox_mode mode, char text[SANDBOX_TEXT_SIZE])
{
    char files[96] =
        "unrestricted files (this kernel has no Landlock, or its parameter lsm= does not list it)";
    int version = landlock_version();
    if (version > 0) snprintf(files, sizeof files, "restricted files (Landlock version %d)", version);
    if (mode == SANDBOX_OFF)
        snprintf(text, SANDBOX_TEXT_SIZE, "off");
    else
        snprintf(text, SANDBOX_TEXT_SIZE, "no new privileges, %s, %s",
                 has_filters() ? "filtered system calls (seccomp)"
                               : "unfiltered system calls (this kernel has no seccomp filters)",
                 files);
    return text;
}
