/* Preloaded into a process (LD_PRELOAD), this counts the blocks of memory that it takes, and moves each to an address
 * of a given remainder by 64, so that tests see what allocates and what depends on addresses. For glibc. */
#include <errno.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

extern void *__libc_malloc(size_t);
extern void __libc_free(void *);

enum { LINE = 64, HEADER = 16 };

static long taken;      /* blocks so far */
static size_t shift;    /* remainder of the next ones: 0, 16, 32 or 48; MIXED: one after the other */
enum { MIXED = 64 };

long blocks_taken(void) { return __atomic_load_n(&taken, __ATOMIC_RELAXED); }
void place_blocks_at(size_t remainder) { shift = remainder; }

/* In front of a block: where it was taken, and its size. */
static void *take(size_t size, size_t alignment) {
    long before = __atomic_fetch_add(&taken, 1, __ATOMIC_RELAXED);
    size_t offset = shift == MIXED ? 16 * (size_t)(before % 4) : shift;
    if (alignment > HEADER) offset = 0;
    if (alignment < LINE) alignment = LINE;
    if (size > SIZE_MAX - 2 * alignment - HEADER) return NULL;
    char *from = __libc_malloc(size + 2 * alignment + HEADER);
    if (!from) return NULL;
    uintptr_t line = ((uintptr_t)from + HEADER + alignment - 1) / alignment * alignment;
    char *block = (char *)line + offset;
    ((void **)block)[-1] = from;
    ((size_t *)block)[-2] = size;
    return block;
}

void *malloc(size_t size) {
    void *block = take(size, HEADER);
    if (!block) errno = ENOMEM;
    return block;
}

void free(void *block) {
    if (block) __libc_free(((void **)block)[-1]);
}

void *calloc(size_t count, size_t size) {
    size_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes)) {
        errno = ENOMEM;
        return NULL;
    }
    void *block = malloc(bytes);
    return block ? memset(block, 0, bytes) : NULL;
}

void *realloc(void *block, size_t size) {
    if (!block) return malloc(size);
    if (!size) {
        free(block);
        return NULL;
    }
    void *moved = malloc(size);
    if (!moved) return NULL;
    size_t old = ((size_t *)block)[-2];
    memcpy(moved, block, old < size ? old : size);
    free(block);
    return moved;
}

int posix_memalign(void **out, size_t alignment, size_t size) {
    void *block = take(size, alignment);
    if (!block) return ENOMEM;
    *out = block;
    return 0;
}

void *aligned_alloc(size_t alignment, size_t size) { return take(size, alignment); }
void *memalign(size_t alignment, size_t size) { return take(size, alignment); }
void *valloc(size_t size) { return take(size, 4096); }
size_t malloc_usable_size(void *block) { return block ? ((size_t *)block)[-2] : 0; }
