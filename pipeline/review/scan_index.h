// SPDX-License-Identifier: GPL-3.0-or-later
// The index on the first page of a review. With this index, a reader of the page can search, filter
// and sort the scans of all pages.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace trocar::pipeline {

/// Largest number of scans in the index. A scan takes 20 to 35 bytes of text in addition to its
/// name, and a name has at most 120 bytes. So the index has at most about 15 MB (155 bytes for each
/// of 100,000 scans).
inline constexpr std::size_t kMaxIndexed = 100'000;

class ScanIndex {
 public:
  struct Row {
    /// kDone: the asset could be read. kFailed: the scan failed. kDamaged: the asset, or the scan's
    /// entry in the store's index, cannot be read. kDifferent: the scan differs between the two
    /// stores that the review compares. kFailedProduct: a product of the scan failed. kWarned: the
    /// scan was meshed with warnings.
    enum Flag : std::uint8_t {
      kDone = 1,
      kFailed = 2,
      kDamaged = 4,
      kDifferent = 8,
      kFailedProduct = 16,
      kWarned = 32
    };
    std::string name;
    unsigned flags = 0;  ///< a sum of values of Flag
    /// Numbers of the asset; std::nullopt if the asset could not be read. An asset without
    /// triangles has `bytes` only.
    std::optional<std::uint64_t> bytes = {}, triangles = {}, slices = {};
  };

  /// Makes an index for `scans` scans. Only the first kMaxIndexed of them get a row.
  explicit ScanIndex(std::size_t scans);
  /// Sets the row of a scan. `place` is the number of the scan's card, counted from 0 over all
  /// pages. If `place` is kMaxIndexed or more, nothing happens.
  void set(std::size_t place, Row row);
  /// The rows as one array for each column, because that is the shortest text. The position of a
  /// scan in the arrays determines its page. "further" is the number of scans without a row.
  nlohmann::json as_json() const;

 private:
  std::vector<Row> rows_;
  std::size_t further_;
};

}  // namespace trocar::pipeline
