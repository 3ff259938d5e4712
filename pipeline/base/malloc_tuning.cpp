// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/base/malloc_tuning.h"

#include <malloc.h>

#include <limits>

namespace trocar::pipeline {

void keep_freed_memory() {
#ifdef __GLIBC__
  // There are no other threads yet. NOLINTBEGIN(concurrency-mt-unsafe)
  mallopt(M_MMAP_THRESHOLD, std::numeric_limits<int>::max());
  mallopt(M_TRIM_THRESHOLD, -1);  // never
  // NOLINTEND(concurrency-mt-unsafe)
#endif
}

}  // namespace trocar::pipeline
