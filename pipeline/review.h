// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh review`: pages with a picture of every asset of a store, and what has changed
// against another store.
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
  std::filesystem::path against;  ///< another store; empty: none
  std::filesystem::path page;     ///< a .html; further pages stand beside it as NAME-2.html, ...
  const std::atomic<bool>* stop = nullptr;
  std::function<void(std::size_t done, std::size_t total)> progress = {};
};

/// Writes the pages and returns their numbers, `trocar.review/1`. Each page holds kScansPerPage
/// scans: those that differ or could not be made first, the worst first, then the others by name.
/// A page needs no other file, and the memory needed is that of one page. Pages of an earlier,
/// longer review with the same name are removed. An asset that is missing or damaged is shown as
/// such. Errors: (refused) a folder that is no store, or a store without scans; (unwritable).
Result<nlohmann::json> write_review(const ReviewOptions& options);

}  // namespace trocar::pipeline
