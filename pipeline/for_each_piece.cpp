// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/for_each_piece.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <atomic>

namespace trocar::pipeline {
namespace {

// The function object that TBB copies and calls. TBB synchronises the pieces with the code before
// and after the loop inside its library, where ThreadSanitizer does not see it. `begun` and `ended`
// repeat this synchronisation, so that ThreadSanitizer checks what the pieces share
// (scripts/lib/tsan.supp excludes this file only).
struct RangeOfPieces {
  const std::function<void(int)>* one_piece;
  std::atomic<int>*begun, *ended;
  void operator()(const oneapi::tbb::blocked_range<int>& range) const {
    begun->load(std::memory_order_acquire);
    for (int piece = range.begin(); piece < range.end(); ++piece)
      (*one_piece)(piece);
    ended->fetch_add(1, std::memory_order_release);
  }
};

}  // namespace

void for_each_piece(int pieces, const std::function<void(int)>& one_piece) {
  std::atomic<int> begun{0}, ended{0};
  begun.store(1, std::memory_order_release);
  oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<int>(0, pieces),
                            RangeOfPieces{&one_piece, &begun, &ended},
                            oneapi::tbb::simple_partitioner());
  ended.load(std::memory_order_acquire);
}

}  // namespace trocar::pipeline
