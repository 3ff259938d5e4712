// SPDX-License-Identifier: Apache-2.0
// Makes the container in which the console sends binary data: JSON and then arrays (protocol.md).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

namespace trocar::runtime {

/// Collects the arrays of one container and makes the container.
class Arrays {
 public:
  /// Appends an array, aligned to the size of its numbers. Returns two values: the offset of the
  /// array in bytes from the start of the first array, and the count of its numbers.
  template <typename Number>
  std::array<std::size_t, 2> add(const std::vector<Number>& numbers) {
    bytes_.resize((bytes_.size() + sizeof(Number) - 1) / sizeof(Number) * sizeof(Number));
    const std::size_t at = bytes_.size();
    bytes_.append(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(Number));
    return {at, numbers.size()};
  }
  /// Returns the whole container: the length of the JSON as four bytes, the JSON, and the arrays.
  /// The JSON ends with blanks, so that the arrays begin at a multiple of 8 bytes.
  std::string with_json(std::string_view json) const {
    std::string out(4, '\0');
    out += json;
    out.resize((out.size() + 7) / 8 * 8, ' ');
    const auto size = static_cast<std::uint32_t>(out.size() - 4);
    std::memcpy(out.data(), &size, sizeof size);
    return out += bytes_;
  }

 private:
  std::string bytes_;
};

}  // namespace trocar::runtime
