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
  std::filesystem::path against;  ///< store to compare with; empty: no comparison
  std::filesystem::path page;     ///< NAME.html; further pages are NAME-2.html and so on
  const std::atomic<bool>* stop = nullptr;
  std::function<void(std::size_t done, std::size_t total)> progress = {};
};

/// Writes the pages and returns the numbers shown in them as JSON (`trocar.review/1`).
///
/// Each scan has a card with its picture. A page shows up to kScansPerPage cards: first those of
/// scans that differ, the most serious differences first, then those of scans that failed or are
/// damaged, then the others by name. A card links to the scan's report, asset and products in the
/// store, and names the products that failed. A missing or damaged asset is reported on its card. A
/// page needs no other file to be shown.
///
/// The first page has an index of all scans (scan_index.h). It searches, filters and sorts the
/// scans of all pages, and its results link to the cards. The other pages link to the first page
/// and have no index of their own, because the size of a review would then grow with the square of
/// the number of scans. Only one page and the index are in memory at a time. The first page is
/// written last. Pages of an earlier, longer review with the same name are removed.
///
/// Errors: kRefused if a folder is not a store, or the store has no scans; kUnwritable if a page
/// cannot be written, or `stop` was set.
Result<nlohmann::json> write_review(const ReviewOptions& options);

}  // namespace trocar::pipeline
