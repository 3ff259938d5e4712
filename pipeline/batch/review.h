// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh review`: HTML pages with a picture of every asset of a store. On request, the pages
// also show the differences from another store.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "formats/base/result.h"

namespace trocar::pipeline {

struct ReviewOptions {
  std::filesystem::path store;
  std::filesystem::path against;  ///< store to compare with; empty: no comparison
  std::filesystem::path page;     ///< first page, NAME.html; the others are NAME-2.html and so on
  const std::atomic<bool>* stop = nullptr;  ///< the caller sets it to end the review early
  /// Called after each page. `done` counts the scans on the pages written so far, `total`
  /// counts all scans.
  std::function<void(std::size_t done, std::size_t total)> progress = {};
};

/// Writes the pages and returns the numbers shown in them as JSON (`trocar.review/1`).
///
/// Each scan of the store has a card with its picture. If the review compares two stores, the cards
/// of scans that differ come first, the most serious differences at the front. The cards of scans
/// that failed, or whose entry in the store's index cannot be read, follow, and then all other
/// cards; these two groups are sorted by name. A card links to the scan's report and asset in the
/// store. A missing or damaged asset is reported on its card. A page contains everything that it
/// shows; only the files to which cards link are not in it.
///
/// The first page has an index of all scans, by which it searches, filters and sorts the scans of
/// all pages; the results link to the cards. The other pages link to the first page. They have no
/// index, because otherwise the size of a review would grow with the square of the number of scans.
/// Only one page and the index are in memory at a time. The first page is written last, because the
/// index needs the numbers of all assets. Pages of an earlier, longer review with the same name are
/// removed.
///
/// Errors: kRefused if a folder is not a store, or the store has no scans; kUnwritable if a page
/// cannot be written, if a file with the name of a later page is not a page of this review, or if
/// `stop` was set.
Result<nlohmann::json> write_review(const ReviewOptions& options);

}  // namespace trocar::pipeline
