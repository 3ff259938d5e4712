// SPDX-License-Identifier: Apache-2.0
// The hard cases of tests/corpus: small JSON files, each named after what it shows, each with a
// field `right` that says in words what is right there and `expect`, the same for the machine.
// Unit tests and fuzzers read them alike: a file more is a test more. Formats: corpus/README.md.
#pragma once

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "formats/base/strict_json.h"

namespace trocar::test {

/// In alphabetical order, so that tests come in the same order everywhere.
inline std::vector<std::filesystem::path> case_files(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> out;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() == ".json") out.push_back(entry.path());
  }
  std::sort(out.begin(), out.end());
  return out;
}

inline std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// A file's name as GoogleTest wants it.
inline std::string test_name(const std::filesystem::path& file) {
  std::string name = file.stem().string();
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return name;
}

/// Far more than any case needs: what a fuzzer may claim.
inline constexpr std::size_t kMostPoints = 20'000, kMostParts = 20'000;

/// [[x, y], ...] in lattice steps, each coordinate at most `most`.
inline Ring read_ring(const nlohmann::json& value, const std::string& path, std::int64_t most,
                      JsonErrors& errors) {
  Ring out;
  if (!value.is_array() || value.size() > kMostPoints) {
    errors.add(path, "must be an array of points");
    return out;
  }
  for (const nlohmann::json& point : value) {
    const auto coordinate = [&](std::size_t i) -> std::int32_t {
      const bool fits = point.is_array() && point.size() == 2 && point[i].is_number_integer() &&
                        (!point[i].is_number_unsigned() ||
                         point[i].get<std::uint64_t>() <= static_cast<std::uint64_t>(most)) &&
                        point[i].get<std::int64_t>() >= -most;
      if (!fits)
        errors.add(path, "a point must be two integers of at most " + std::to_string(most));
      return fits ? point[i].get<std::int32_t>() : 0;
    };
    out.push_back({coordinate(0), coordinate(1)});
  }
  return out;
}

inline std::vector<Ring> read_rings(const nlohmann::json& value, const std::string& path,
                                    std::int64_t most, JsonErrors& errors) {
  std::vector<Ring> out;
  if (!value.is_array() || value.size() > kMostParts) {
    errors.add(path, "must be an array of rings");
    return out;
  }
  for (const nlohmann::json& ring : value)
    out.push_back(read_ring(ring, path, most, errors));
  return out;
}

/// Present only if the key is.
inline std::optional<std::int64_t> optional_integer(StrictObject& object, const char* key,
                                                    std::int64_t lowest, std::int64_t highest) {
  if (!object.has(key)) return std::nullopt;
  return object.integer(key, lowest, highest);
}
inline std::optional<double> optional_number(StrictObject& object, const char* key, double lowest,
                                             double highest) {
  if (!object.has(key)) return std::nullopt;
  return object.number(key, lowest, highest);
}
inline std::string optional_string(StrictObject& object, const char* key) {
  return object.has(key) ? object.string(key) : std::string();
}

}  // namespace trocar::test
