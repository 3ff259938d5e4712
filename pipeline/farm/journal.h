// SPDX-License-Identifier: GPL-3.0-or-later
// A store's journal: what each process did when, for people and for sizing chunks of work. A line
// of JSON a scan, a file a process. Nothing depends on it.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace trocar::farm {

class Journal {
 public:
  /// The file is made by the first line.
  explicit Journal(std::filesystem::path folder) : folder_(std::move(folder)) {}
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;
  ~Journal();
  /// Adds `time`, `host` and `pid`. False: it could not be written.
  bool add(nlohmann::json line);

 private:
  std::filesystem::path folder_;
  int fd_ = -1;
};

}  // namespace trocar::farm
