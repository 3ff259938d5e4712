// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh review`: writes HTML pages that show a store's assets.
#pragma once

#include <filesystem>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct ReviewArguments {
  std::filesystem::path store, page, against;  ///< against: store to compare with, or empty
  bool as_json = false, quiet = false;
};

/// Declares the options. Parsing writes their values to `a`.
void add_review_options(CLI::App& command, ReviewArguments& a);

/// Writes the pages and returns the exit code: 0, even if assets are damaged or differ from those
/// in `against`; 2 for wrong options; 3 if a folder is not a store, or if `store` has no scans; 4
/// if a page could not be written or a signal interrupted the review.
int run_review(const ReviewArguments& a);

}  // namespace trocar::pipeline
