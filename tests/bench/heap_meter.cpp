// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/heap_meter.h"

#include <malloc.h>

#include <atomic>
#include <cstdlib>
#include <new>

namespace trocar::test {
namespace {

std::atomic<std::int64_t> now{0}, most{0};

void count(std::int64_t bytes) noexcept {
  const std::int64_t total = now.fetch_add(bytes) + bytes;
  std::int64_t before = most.load();
  while (total > before && !most.compare_exchange_weak(before, total)) {
  }
}

void* counted(void* block) {
  if (block == nullptr) throw std::bad_alloc();
  count(static_cast<std::int64_t>(malloc_usable_size(block)));
  return block;
}

void release(void* block) noexcept {
  if (block == nullptr) return;
  now.fetch_sub(static_cast<std::int64_t>(malloc_usable_size(block)));
  std::free(block);
}

}  // namespace

HeapBytes heap_bytes() noexcept {
  return {now.load(), most.load()};
}

void reset_heap_peak() noexcept {
  most.store(now.load());
}

}  // namespace trocar::test

using trocar::test::counted;
using trocar::test::release;

void* operator new(std::size_t size) {
  return counted(std::malloc(size));
}
void* operator new[](std::size_t size) {
  return counted(std::malloc(size));
}
void* operator new(std::size_t size, std::align_val_t align) {
  const auto step = static_cast<std::size_t>(align);
  return counted(std::aligned_alloc(step, (size + step - 1) / step * step));
}
void* operator new[](std::size_t size, std::align_val_t align) {
  return operator new(size, align);
}
void operator delete(void* block) noexcept {
  release(block);
}
void operator delete[](void* block) noexcept {
  release(block);
}
void operator delete(void* block, std::size_t) noexcept {
  release(block);
}
void operator delete[](void* block, std::size_t) noexcept {
  release(block);
}
void operator delete(void* block, std::align_val_t) noexcept {
  release(block);
}
void operator delete[](void* block, std::align_val_t) noexcept {
  release(block);
}
void operator delete(void* block, std::size_t, std::align_val_t) noexcept {
  release(block);
}
void operator delete[](void* block, std::size_t, std::align_val_t) noexcept {
  release(block);
}
