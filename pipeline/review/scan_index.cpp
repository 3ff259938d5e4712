// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review/scan_index.h"

#include <algorithm>
#include <utility>

namespace trocar::pipeline {

using nlohmann::json;

ScanIndex::ScanIndex(std::size_t scans)
    : rows_(std::min(scans, kMaxIndexed)), further_(scans - rows_.size()) {}

void ScanIndex::set(std::size_t place, Row row) {
  if (place < rows_.size()) rows_[place] = std::move(row);
}

json ScanIndex::as_json() const {
  const auto value = [](const std::optional<std::uint64_t>& number) {
    return number ? json(*number) : json();
  };
  json names = json::array(), flags = names, bytes = names, triangles = names, slices = names;
  for (const Row& row : rows_) {
    names.push_back(row.name);
    flags.push_back(row.flags);
    bytes.push_back(value(row.bytes));
    triangles.push_back(value(row.triangles));
    slices.push_back(value(row.slices));
  }
  return {{"names", std::move(names)},   {"flags", std::move(flags)},
          {"bytes", std::move(bytes)},   {"triangles", std::move(triangles)},
          {"slices", std::move(slices)}, {"further", further_}};
}

}  // namespace trocar::pipeline
