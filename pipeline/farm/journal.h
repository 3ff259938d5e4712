// SPDX-License-Identifier: GPL-3.0-or-later
// A store's journal, with times and outcomes: each process has a file, with one line of JSON for
// each scan. It is for people, and for choosing the size of tasks. The store's correctness does not
// depend on it.
// Tests: tests/e2e/batch_test.py
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace trocar::farm {

class Journal {
 public:
  /// The journal's file is created when the first line is added.
  explicit Journal(std::filesystem::path folder) : folder_(std::move(folder)) {}
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;
  ~Journal();
  /// Adds `time`, `host` and `pid` to the line and writes it. Returns false if it could not be
  /// written.
  bool add(nlohmann::json line);

 private:
  std::filesystem::path folder_;
  int fd_ = -1;
};

}  // namespace trocar::farm
