// SPDX-License-Identifier: Apache-2.0
// Reading the stress cases of tests/corpus: small JSON files, each named after what it shows. The
// field `right` states the correct result in words, `expect` states it for the test. Unit tests and
// fuzzers read the same files, so a new file is a new test. Formats: tests/corpus/README.md.
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

#include "formats/base/json.h"
#include "formats/base/result.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar::test {

/// The JSON files of a folder in alphabetical order, so that tests have the same order everywhere.
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

/// A file's name as a GoogleTest name.
inline std::string test_name(const std::filesystem::path& file) {
  std::string name = file.stem().string();
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return name;
}

/// Limits on sizes that a fuzzed file may state; far above those of the corpus.
inline constexpr std::size_t kMaxPoints = 20'000, kMaxParts = 20'000;

/// [[x, y], ...] in lattice steps, each coordinate at most `most`.
inline Ring read_ring(const nlohmann::json& value, const std::string& path, std::int64_t most,
                      JsonErrors& errors) {
  Ring out;
  if (!value.is_array() || value.size() > kMaxPoints) {
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
  if (!value.is_array() || value.size() > kMaxParts) {
    errors.add(path, "must be an array of rings");
    return out;
  }
  for (const nlohmann::json& ring : value)
    out.push_back(read_ring(ring, path, most, errors));
  return out;
}

/// The value of the key, if it is present.
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
