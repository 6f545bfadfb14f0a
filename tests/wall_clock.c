// Preloaded into a process, its wall clock is off by the nanoseconds in the file that WALL_CLOCK_FILE names: the step of a host's
// clock, for chosen processes, at once. Monotonic time and sleeping stay as they are (libfaketime 0.9.10 cannot do that: with
// FAKETIME_DONT_FAKE_MONOTONIC=1 it makes clock_nanosleep fail with EINVAL).
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

// offset in ns at `since_ns` of the monotonic clock, and the rate beyond 1 from there on, in 1e-9
static const volatile struct { int64_t offset_ns, rate_ppb, since_ns; } *off;

__attribute__((constructor)) static void open_file(void) {
    const char *path = getenv("WALL_CLOCK_FILE");
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *page = fd < 0 ? MAP_FAILED : mmap(0, sizeof *off, PROT_READ, MAP_SHARED, fd, 0);
    if (page != MAP_FAILED) off = page;
    if (fd >= 0) close(fd);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    int status = (int)syscall(SYS_clock_gettime, clock, now);
    if (status == 0 && off && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) {
        struct timespec steady = {0, 0};
        if (off->rate_ppb) syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &steady);
        int64_t gone_us = off->rate_ppb ? (steady.tv_sec * 1000000000LL + steady.tv_nsec - off->since_ns) / 1000 : 0;
        int64_t ns = now->tv_sec * 1000000000LL + now->tv_nsec + off->offset_ns + gone_us * off->rate_ppb / 1000000;
        now->tv_sec = ns / 1000000000LL;
        now->tv_nsec = ns % 1000000000LL;
    }
    return status;
}

int gettimeofday(struct timeval *now, void *zone) {
    struct timespec spec;
    int status = clock_gettime(CLOCK_REALTIME, &spec);
    now->tv_sec = spec.tv_sec;
    now->tv_usec = spec.tv_nsec / 1000;
    return status;
}

time_t time(time_t *where) {
    struct timespec spec;
    clock_gettime(CLOCK_REALTIME, &spec);
    if (where) *where = spec.tv_sec;
    return spec.tv_sec;
}
