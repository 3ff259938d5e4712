// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh review`: its options and its output.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>

namespace trocar::pipeline {

struct ReviewArguments {
  std::filesystem::path store, page, against;
  bool as_json = false, quiet = false;
};

/// Declares the options; `a` must outlive the app.
void add_review_options(CLI::App& app, ReviewArguments& a);

/// Gives the exit code: 0 also if assets differ or are damaged; 2 wrong options; 3 no store, or an
/// empty one; 4 a page could not be written, or interrupted.
int run_review(const ReviewArguments& a);

}  // namespace trocar::pipeline
