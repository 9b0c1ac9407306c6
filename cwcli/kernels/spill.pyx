# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Where NumPy's large arrays lie: in memory up to a bound, beyond it in a file without a name that is mapped.

NumPy asks a handler for the memory of each array (NEP 49). This one hands everything on to NumPy's own until the large
arrays that are alive together pass the bound. Those that come after get pages of the file, whose space is reserved
first, so that a full disk is found here and not by a signal later; if it can't be reserved they get memory all the same.
Nothing but the place differs: values, results and bytes written are the same.

What is freed is used again, the rest given back to the file system. The pages that the process holds of the file are
let go now and then: they stay in the system's cache, or are on the disk, and come back when they are read.

A process that is forked off has a page of its own from when it writes to it; the others change with its parent, who must
neither change nor free those arrays before the fork is done. Its own lie in memory; the file is its parent's.
"""

from libc.stdint cimport uint8_t, uint32_t
from libc.stdlib cimport calloc, realloc
from libc.string cimport memcpy, memmove, memset

cdef extern from *:
    """
    #include <stddef.h>
    typedef struct {
        void *ctx;
        void *(*malloc)(void *ctx, size_t size);
        void *(*calloc)(void *ctx, size_t count, size_t size);
        void *(*realloc)(void *ctx, void *pointer, size_t size);
        void (*free)(void *ctx, void *pointer, size_t size);
    } spill_allocator;
    typedef struct { char name[127]; unsigned char version; spill_allocator allocator; } spill_handler;
    #define NUMPY_SET_HANDLER 304
    #define NUMPY_GET_HANDLER 305
    #define SPILL_PAUSE_MS 10
    static PyObject *numpy_set_handler(void **api, PyObject *handler) {
        return ((PyObject *(*)(PyObject *))api[NUMPY_SET_HANDLER])(handler);
    }
    static PyObject *numpy_get_handler(void **api) { return ((PyObject *(*)(void))api[NUMPY_GET_HANDLER])(); }

    #if defined(__linux__)
    #include <errno.h>
    #include <fcntl.h>
    #include <malloc.h>
    #include <pthread.h>
    #include <signal.h>
    #include <sys/mman.h>
    #include <sys/resource.h>
    #include <sys/vfs.h>
    #include <time.h>
    #include <unistd.h>
    #ifndef FALLOC_FL_KEEP_SIZE
    #define FALLOC_FL_KEEP_SIZE 1
    #endif
    #ifndef FALLOC_FL_PUNCH_HOLE
    #define FALLOC_FL_PUNCH_HOLE 2
    #endif
    int fallocate(int, int, off_t, off_t);
    #define SPILL_IS_POSSIBLE 1
    static int spill_is_in_memory(int fd) {  /* tmpfs and ramfs */
        struct statfs found;
        return !fstatfs(fd, &found) && ((unsigned)found.f_type == 0x01021994u || (unsigned)found.f_type == 0x858458f6u);
    }
    static pthread_mutex_t spill_mutex = PTHREAD_MUTEX_INITIALIZER;
    static void spill_lock(void) { pthread_mutex_lock(&spill_mutex); }
    static void spill_unlock(void) { pthread_mutex_unlock(&spill_mutex); }
    static size_t spill_usable(void *pointer) { return malloc_usable_size(pointer); }
    static void *spill_base = 0;
    static size_t spill_size = 0;
    static int spill_file = -1, spill_is_forked = 0;
    static void *spill_map(int fd, size_t *size) {  /* half of the addresses that the process may have */
        struct rlimit most;
        size_t limit = *size;
        if (!getrlimit(RLIMIT_AS, &most) && most.rlim_cur != RLIM_INFINITY && most.rlim_cur / 2 < limit)
            limit = most.rlim_cur / 2;
        limit -= limit % (1 << 20);
        *size = limit;
        void *found = limit ? mmap(0, limit, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_NORESERVE, fd, 0) : MAP_FAILED;
        if (found == MAP_FAILED) return 0;
        spill_size = limit, spill_file = fd;
        return spill_base = found;
    }
    static int spill_reserve(int fd, size_t offset, size_t size) {
        int found;
        while ((found = fallocate(fd, 0, offset, size)) && errno == EINTR) { }
        return found;
    }
    static void spill_give_back(int fd, size_t offset, size_t size) {
        if (fallocate(fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, offset, size)) { /* it stays reserved */ }
    }
    static void spill_let_go(void *base, size_t size) { madvise(base, size, MADV_DONTNEED); }
    static void spill_fork_child(void) {
        int how = MAP_PRIVATE | MAP_NORESERVE | MAP_FIXED;
        spill_unlock();
        spill_is_forked = 1;
        if (spill_base && mmap(spill_base, spill_size, PROT_READ | PROT_WRITE, how, spill_file, 0) == MAP_FAILED) abort();
    }
    static void spill_watch_forks(void) { pthread_atfork(spill_lock, spill_unlock, spill_fork_child); }
    static void *spill_repeat(void *look) {
        struct timespec pause = {0, SPILL_PAUSE_MS * 1000000L};
        for (;;) {
            nanosleep(&pause, 0);
            ((void (*)(void))look)();
        }
        return 0;
    }
    static void spill_start(void (*look)(void)) {  /* a kernel may work on its arrays for a minute */
        pthread_t thread;
        sigset_t all, before;
        sigfillset(&all);
        pthread_sigmask(SIG_SETMASK, &all, &before);
        if (!pthread_create(&thread, 0, spill_repeat, (void *)look)) pthread_detach(thread);
        pthread_sigmask(SIG_SETMASK, &before, 0);
    }
    static size_t spill_mapped(void) {  /* pages of files that the process holds, in bytes */
        char text[128];
        size_t total = 0;
        int fd = open("/proc/self/statm", O_RDONLY | O_CLOEXEC), field = 0;
        if (fd < 0) return 0;
        ssize_t n = read(fd, text, sizeof text), i;
        close(fd);
        for (i = 0; i < n && field < 3; i++) {
            if (text[i] == ' ') field++;
            else if (field == 2) total = total * 10 + (text[i] - '0');
        }
        return total * sysconf(_SC_PAGESIZE);
    }
    #else
    #define SPILL_IS_POSSIBLE 0
    static int spill_is_in_memory(int fd) { return 1; }
    static void spill_lock(void) { } static void spill_unlock(void) { }
    static size_t spill_usable(void *pointer) { return 0; }
    static void *spill_map(int fd, size_t *size) { return 0; }
    static int spill_reserve(int fd, size_t offset, size_t n) { return -1; }
    static void spill_give_back(int fd, size_t offset, size_t n) { }
    static void spill_let_go(void *base, size_t size) { } static void spill_start(void (*look)(void)) { }
    static size_t spill_mapped(void) { return 0; }
    static void spill_watch_forks(void) { } static const int spill_is_forked = 0;
    #endif
    """
    ctypedef struct Allocator "spill_allocator":
        void* ctx
        void* (*malloc)(void*, size_t) noexcept nogil
        void* (*calloc)(void*, size_t, size_t) noexcept nogil
        void* (*realloc)(void*, void*, size_t) noexcept nogil
        void (*free)(void*, void*, size_t) noexcept nogil
    ctypedef struct Handler "spill_handler":
        char name[127]
        uint8_t version
        Allocator allocator
    object numpy_set_handler(void** api, object handler)
    object numpy_get_handler(void** api)
    bint spill_is_in_memory(int fd)
    void spill_lock() noexcept nogil
    void spill_unlock() noexcept nogil
    size_t spill_usable(void*) noexcept nogil
    void* spill_map(int fd, size_t* size) noexcept nogil
    int spill_reserve(int fd, size_t offset, size_t size) noexcept nogil
    void spill_give_back(int fd, size_t offset, size_t size) noexcept nogil
    void spill_let_go(void* base, size_t size) noexcept nogil
    void spill_start(void (*look)() noexcept nogil) noexcept nogil
    size_t spill_mapped() noexcept nogil
    void spill_watch_forks() noexcept nogil
    bint SPILL_IS_POSSIBLE, spill_is_forked

cdef extern from "Python.h":
    void* PyCapsule_GetPointer(object, const char*) except NULL
    object PyCapsule_New(void*, const char*, void*)

cdef enum:
    HANDLER_VERSION = 1
    GRAIN = 1 << 16  # spans of the file are multiples of it
    LARGE = 1 << 18  # bytes of an array that is counted, and that the file may take
    MOST_UNUSED = 1 << 27  # bytes of freed spans that are kept for the next arrays

cdef struct Span:
    size_t first, n
    bint is_backed

cdef Handler handler
cdef Allocator numpy_own
cdef int descriptor = -1
cdef char* base = NULL
cdef size_t capacity = 0, end = 0, bound = 0, most_mapped = 0
cdef size_t held = 0, in_file = 0, most_in_file = 0, unused = 0, mapped_before = 0
cdef uint32_t* grains = NULL
cdef Span* spans = NULL
cdef Py_ssize_t n_spans = 0, room = 0


cdef inline bint is_ours(void* pointer) noexcept nogil:
    return base != NULL and base <= <char*> pointer < base + capacity


cdef void* own_malloc(void* ctx, size_t size) noexcept nogil:
    cdef void* found = NULL
    if size >= LARGE:
        found = from_file(size)
    if found == NULL:
        found = counted(numpy_own.malloc(numpy_own.ctx, size))
    return found


cdef void* own_calloc(void* ctx, size_t count, size_t size) noexcept nogil:
    cdef void* found = NULL
    if size and count <= (<size_t> -1) / size and count * size >= LARGE:
        found = from_file(count * size)
        if found != NULL:
            memset(found, 0, count * size)
    if found == NULL:
        found = counted(numpy_own.calloc(numpy_own.ctx, count, size))
    return found


cdef void* own_realloc(void* ctx, void* pointer, size_t size) noexcept nogil:
    cdef size_t before
    cdef void* found
    if not is_ours(pointer):
        found = from_file(size) if size >= LARGE and pointer != NULL else NULL
        if found != NULL:
            memcpy(found, pointer, min(spill_usable(pointer), size))
            own_free(ctx, pointer, LARGE)  # a size that NumPy keeps no memory of for later
            return found
        uncounted(pointer)
        found = numpy_own.realloc(numpy_own.ctx, pointer, size)
        counted(found if found != NULL else pointer)
        return found
    before = grains[(<char*> pointer - base) / GRAIN] * <size_t> GRAIN
    if before / 2 <= size <= before:
        return pointer
    found = own_malloc(ctx, size)
    if found != NULL:
        memcpy(found, pointer, min(before, size))
        own_free(ctx, pointer, 0)
    return found


cdef void own_free(void* ctx, void* pointer, size_t size) noexcept nogil:
    if is_ours(pointer):
        spill_lock()
        if not spill_is_forked:
            freed(<char*> pointer - base)
        spill_unlock()
    else:
        uncounted(pointer)
        numpy_own.free(numpy_own.ctx, pointer, size)


cdef void* counted(void* pointer) noexcept nogil:
    global held
    cdef size_t size = spill_usable(pointer) if pointer != NULL else 0
    if size >= LARGE:
        spill_lock()
        held += size
        spill_unlock()
    return pointer


cdef void uncounted(void* pointer) noexcept nogil:
    global held
    cdef size_t size = spill_usable(pointer) if pointer != NULL else 0
    if size >= LARGE:
        spill_lock()
        held -= min(held, size)  # NumPy's own may have got it before this one was there
        spill_unlock()


cdef void* from_file(size_t size) noexcept nogil:
    """Pages of the file, or NULL: the bound is not reached, or there is no room."""
    cdef void* found = NULL
    cdef size_t n = (size + GRAIN - 1) / GRAIN * GRAIN
    spill_lock()
    if held + size > bound and n >= size and not spill_is_forked:
        found = taken(n)
    spill_unlock()
    return found


cdef void look_after() noexcept nogil:
    """Let the file's pages go, if the process holds many more of files than it did at its least; in a thread of its own."""
    global mapped_before
    cdef size_t mapped = spill_mapped(), half = most_mapped / 2
    mapped_before = min(mapped, mapped_before or mapped)
    if mapped > mapped_before + most_mapped:
        spill_let_go(base, end)
        mapped_before = max(mapped_before + half, spill_mapped()) - half  # those of libraries come and stay


cdef void* taken(size_t n) noexcept nogil:
    """The smallest free span that is large enough, else new ones at the end."""
    global end, base, capacity, grains, in_file, most_in_file, unused
    cdef Py_ssize_t i, best = -1
    cdef size_t first
    if base == NULL:
        base = <char*> spill_map(descriptor, &capacity)
        grains = <uint32_t*> calloc(capacity / GRAIN + 1, sizeof(uint32_t)) if base != NULL else NULL
        if grains == NULL:
            base, capacity = NULL, 0
        else:
            spill_start(look_after)
    for i in range(n_spans):
        if spans[i].n >= n and (best < 0 or spans[i].n < spans[best].n):
            best = i
    if best < 0 and n > capacity - end:
        return NULL
    first = spans[best].first if best >= 0 else end
    if (best < 0 or not spans[best].is_backed) and spill_reserve(descriptor, first, n):
        return NULL
    if best < 0:
        end += n
    else:
        if spans[best].is_backed:
            unused -= n
        spans[best].first += n
        spans[best].n -= n
        if not spans[best].n:
            remove_span(best)
    grains[first / GRAIN] = <uint32_t> (n / GRAIN)
    in_file += n
    most_in_file = max(most_in_file, in_file)
    return base + first


cdef void freed(size_t first) noexcept nogil:
    """A span is free again: joined to its neighbours if they are like it."""
    global spans, room, n_spans, unused, in_file
    cdef size_t n = grains[first / GRAIN] * <size_t> GRAIN
    cdef Py_ssize_t at = 0, last = n_spans, middle
    cdef Span* more
    cdef bint is_backed = unused + n <= MOST_UNUSED
    in_file -= n
    if n_spans == room:
        more = <Span*> realloc(spans, (2 * room + 64) * sizeof(Span))
        if more == NULL:
            return  # its place is lost; its pages stay
        spans, room = more, 2 * room + 64
    if is_backed:
        unused += n
    else:
        spill_give_back(descriptor, first, n)
    while at < last:
        middle = (at + last) / 2
        if spans[middle].first < first:
            at = middle + 1
        else:
            last = middle
    if at and spans[at - 1].first + spans[at - 1].n == first and spans[at - 1].is_backed == is_backed:
        at -= 1
        spans[at].n += n
    else:
        memmove(&spans[at + 1], &spans[at], (n_spans - at) * sizeof(Span))
        n_spans += 1
        spans[at].first, spans[at].n, spans[at].is_backed = first, n, is_backed
    at += 1
    if at < n_spans and spans[at - 1].first + spans[at - 1].n == spans[at].first and spans[at].is_backed == is_backed:
        spans[at - 1].n += spans[at].n
        remove_span(at)


cdef void remove_span(Py_ssize_t at) noexcept nogil:
    global n_spans
    n_spans -= 1
    memmove(&spans[at], &spans[at + 1], (n_spans - at) * sizeof(Span))


cdef void** numpy_api():
    from numpy._core import _multiarray_umath

    return <void**> PyCapsule_GetPointer(_multiarray_umath._ARRAY_API, NULL)


def spill_beyond(int fd, size_t bound_bytes, size_t most_mapped_bytes, size_t capacity_bytes):
    global descriptor, bound, most_mapped, capacity, numpy_own
    if not SPILL_IS_POSSIBLE or descriptor >= 0:  # once in a process: the file can't be changed for another
        return None
    own = numpy_get_handler(numpy_api())
    cdef Handler* before = <Handler*> PyCapsule_GetPointer(own, b"mem_handler")
    if before.version != HANDLER_VERSION:
        return None
    numpy_own = before.allocator
    memset(&handler, 0, sizeof(Handler))
    memcpy(handler.name, b"cwcli_spill", 11)
    handler.version = HANDLER_VERSION
    handler.allocator.malloc = own_malloc
    handler.allocator.calloc = own_calloc
    handler.allocator.realloc = own_realloc
    handler.allocator.free = own_free
    spill_watch_forks()
    descriptor, bound, most_mapped, capacity = fd, bound_bytes, most_mapped_bytes, capacity_bytes
    return PyCapsule_New(&handler, b"mem_handler", NULL)


def is_on_disk(int fd):
    return not spill_is_in_memory(fd)


def use(capsule):
    return numpy_set_handler(numpy_api(), capsule)


def counts():
    return {"held": held, "in_file": in_file, "most_in_file": most_in_file, "file": end, "unused": unused}
