// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh list`: prints the scans in a folder.
#pragma once

#include <filesystem>

#include "pipeline/program/arguments.h"

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct ListArguments {
  std::filesystem::path folder;
  std::filesystem::path output;                 ///< file for the collection; empty: standard output
  bool as_json = false, as_collection = false;  ///< as_collection: print a collection (--manifest)
};

/// Declares the options. Parsing writes their values to `a`.
void add_list_options(CLI::App& command, ListArguments& a);

/// Prints the scans and returns the exit code, which is 3 if none of them can be meshed.
int run_list(const ListArguments& a);

// `trocar-mesh preview`: writes a picture (.png) or a page (.html) of what trocar-mesh would mesh
// with the same options.

/// Writes the picture or page and returns the exit code.
int run_preview(Arguments a);

}  // namespace trocar::pipeline

// `trocar-mesh review`: writes HTML pages that show a store's assets.

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
