// SPDX-License-Identifier: Apache-2.0
// Makes an HDF5 file in memory. The file has no time stamps, so that the same calls give the same bytes.
// Tests: tests/e2e/hdf5_export_test.py
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The type of a dataset's elements. All types are little-endian in the file.
enum class Hdf5Type : std::uint8_t { kFloat64, kInt32, kInt64, kUint8, kUint32 };

/// A table of numbers, one row for each tick.
struct Hdf5Table {
  std::string name;
  Hdf5Type type = Hdf5Type::kFloat64;
  std::size_t width = 1;  ///< numbers in a row; with 1 the dataset has one dimension, else two
  /// Names of the values 0, 1, ... The dataset is then an enumeration of 8-bit numbers. Empty: the
  /// dataset has plain numbers.
  std::vector<std::string> enumerators;
  std::vector<std::byte> data;  ///< row by row, in the machine's byte order
};

/// A file with datasets in its root group. Calls report no errors; if one has failed, bytes()
/// returns an error.
class Hdf5File {
 public:
  Hdf5File();
  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;
  ~Hdf5File();

  /// Adds a dataset in compressed chunks.
  void add(const Hdf5Table& table);
  /// Adds an attribute, a text or a list of texts, to a dataset or the root group. `object`: the
  /// name of the dataset, or "/".
  void set_attribute(const std::string& object, const std::string& name, const std::string& text);
  void set_attribute(const std::string& object, const std::string& name,
                     std::span<const std::string> texts);
  /// Returns the file's bytes. Errors: kBug if libhdf5 refused a call, or had no memory.
  Result<std::vector<std::uint8_t>> bytes();

 private:
  std::int64_t file_ = -1;  ///< libhdf5's identifier
  bool has_failed_ = false;
};

/// The version of libhdf5, such as "1.10.8".
std::string hdf5_version();

}  // namespace trocar::runtime
