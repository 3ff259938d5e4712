// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh review`: HTML pages with a picture of every asset of a store, and the differences
// from another store.
// Tests: tests/e2e/review_test.py
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "formats/base/result.h"

namespace trocar::pipeline {

inline constexpr std::size_t kScansPerPage = 240;

struct ReviewOptions {
  std::filesystem::path store;
  std::filesystem::path against;  ///< store to compare with; may be empty
  std::filesystem::path page;     ///< NAME.html; further pages are NAME-2.html and so on
  const std::atomic<bool>* stop = nullptr;
  std::function<void(std::size_t done, std::size_t total)> progress = {};
};

/// Writes the pages and returns their numbers (`trocar.review/1`). Each page shows kScansPerPage
/// scans: first those that differ, the worst first, then those that failed, then the others by
/// name. A page needs no other file, and only one page is in memory at a time. Pages of an earlier,
/// longer review with the same name are removed. A missing or damaged asset is reported on its
/// card. Errors: (refused) a folder that is no store, or a store without scans; (unwritable).
Result<nlohmann::json> write_review(const ReviewOptions& options);

}  // namespace trocar::pipeline
