// SPDX-License-Identifier: Apache-2.0
// Replaces the C library's allocation functions: each call is counted, then passed to glibc's
// original, which it exports under a second name. A definition in the program takes precedence over
// libc's for every library of the process.
#include <cerrno>
#include <cstddef>
#include <cstdlib>

#include "runtime/realtime/realtime_thread.h"

extern "C" {

// NOLINTBEGIN(bugprone-reserved-identifier): glibc's names.
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* block, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* block);
// NOLINTEND(bugprone-reserved-identifier)

void* malloc(std::size_t size) {
  trocar::runtime::note_allocation();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  trocar::runtime::note_allocation();
  return __libc_calloc(count, size);
}
void* realloc(void* block, std::size_t size) {
  trocar::runtime::note_allocation();
  return __libc_realloc(block, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  trocar::runtime::note_allocation();
  return __libc_memalign(alignment, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  trocar::runtime::note_allocation();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** block, std::size_t alignment, std::size_t size) {
  trocar::runtime::note_allocation();
  if (alignment < sizeof(void*) || (alignment & (alignment - 1)) != 0) return EINVAL;
  void* got = __libc_memalign(alignment, size);
  if (got == nullptr) return ENOMEM;
  *block = got;
  return 0;
}
void free(void* block) {
  if (block != nullptr) trocar::runtime::note_allocation();
  __libc_free(block);
}

}  // extern "C"

namespace {
[[maybe_unused]] const bool announced = [] {
  trocar::runtime::announce_allocation_hooks();
  return true;
}();
}  // namespace
