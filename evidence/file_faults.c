// Library for LD_PRELOAD: the n-th file operation below a folder fails, or ends the process.
//
// Counted are opening, writing, flushing, renaming, linking, creating and removing. `fault_arm` sets the folder, the
// number of the operation (0: none) and the action; `fault_count` returns the number of operations since then.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char root[PATH_MAX];
static long target, counted;
static int kills;

void fault_arm(const char *folder, long number, int kill_process) {
  strncpy(root, folder, sizeof root - 1);
  target = number;
  kills = kill_process;
  counted = 0;
}

long fault_count(void) { return counted; }

static int below(int dir, const char *path) {
  char full[2 * PATH_MAX] = "", link[64];
  if (!root[0] || !path) return 0;
  if (path[0] != '/' && dir != AT_FDCWD) {
    snprintf(link, sizeof link, "/proc/self/fd/%d", dir);
    ssize_t n = readlink(link, full, PATH_MAX - 1);
    if (n <= 0) return 0;
    full[n] = '/';
    full[n + 1] = 0;
  }
  strncat(full, path, PATH_MAX - 1);
  return !strncmp(full, root, strlen(root));
}

static int fails(int dir, const char *path) {
  if (!below(dir, path) || ++counted != target) return 0;
  if (kills) kill(getpid(), SIGKILL);
  errno = ENOSPC;
  return 1;
}

static int fd_fails(int fd) {
  char link[64];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  char path[PATH_MAX] = "";
  ssize_t n = readlink(link, path, PATH_MAX - 1);
  return n > 0 && fails(AT_FDCWD, path);
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

#define OPEN(name)                                         \
  int name(const char *path, int flags, ...) {             \
    va_list args;                                          \
    va_start(args, flags);                                 \
    mode_t mode = (flags & O_CREAT) ? va_arg(args, mode_t) : 0; \
    va_end(args);                                          \
    return fails(AT_FDCWD, path) ? -1 : NEXT(name)(path, flags, mode); \
  }
#define OPENAT(name)                                       \
  int name(int dir, const char *path, int flags, ...) {    \
    va_list args;                                          \
    va_start(args, flags);                                 \
    mode_t mode = (flags & O_CREAT) ? va_arg(args, mode_t) : 0; \
    va_end(args);                                          \
    return fails(dir, path) ? -1 : NEXT(name)(dir, path, flags, mode); \
  }
OPEN(open)
OPEN(open64)
OPENAT(openat)
OPENAT(openat64)

ssize_t write(int fd, const void *data, size_t size) { return fd_fails(fd) ? -1 : NEXT(write)(fd, data, size); }
int fsync(int fd) { return fd_fails(fd) ? -1 : NEXT(fsync)(fd); }
int mkdir(const char *path, mode_t mode) { return fails(AT_FDCWD, path) ? -1 : NEXT(mkdir)(path, mode); }
int rmdir(const char *path) { return fails(AT_FDCWD, path) ? -1 : NEXT(rmdir)(path); }
int unlink(const char *path) { return fails(AT_FDCWD, path) ? -1 : NEXT(unlink)(path); }
int unlinkat(int dir, const char *path, int flags) { return fails(dir, path) ? -1 : NEXT(unlinkat)(dir, path, flags); }
int rename(const char *from, const char *to) { return fails(AT_FDCWD, to) ? -1 : NEXT(rename)(from, to); }
int renameat(int a, const char *from, int b, const char *to) {
  return fails(b, to) ? -1 : NEXT(renameat)(a, from, b, to);
}
int renameat2(int a, const char *from, int b, const char *to, unsigned flags) {
  return fails(b, to) ? -1 : NEXT(renameat2)(a, from, b, to, flags);
}
int link(const char *from, const char *to) { return fails(AT_FDCWD, to) ? -1 : NEXT(link)(from, to); }
int linkat(int a, const char *from, int b, const char *to, int flags) {
  return fails(b, to) ? -1 : NEXT(linkat)(a, from, b, to, flags);
}
