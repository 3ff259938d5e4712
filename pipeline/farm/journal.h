// SPDX-License-Identifier: GPL-3.0-or-later
// A store's journal: one JSON line per scan and one file per process, with times and outcomes. It
// serves people and the sizing of tasks; the store's correctness does not depend on it.
// Tests: tests/e2e/batch_test.py
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace trocar::farm {

class Journal {
 public:
  /// The first line creates the file.
  explicit Journal(std::filesystem::path folder) : folder_(std::move(folder)) {}
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;
  ~Journal();
  /// Writes the line with `time`, `host` and `pid` added. Returns false if it could not be written.
  bool add(nlohmann::json line);

 private:
  std::filesystem::path folder_;
  int fd_ = -1;
};

}  // namespace trocar::farm
