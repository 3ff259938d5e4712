// SPDX-License-Identifier: Apache-2.0
// Makes an HDF5 file in memory. The file contains no time stamps, so that the same calls always
// give the same bytes.
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

/// A table of numbers, one row for each tick. Hdf5File::add() stores it as a dataset.
struct Hdf5Table {
  std::string name;
  Hdf5Type type = Hdf5Type::kFloat64;
  /// Number of values in a row. If it is 1, the dataset has one dimension (rows). Otherwise it has
  /// two (rows and values).
  std::size_t width = 1;
  /// If empty, the dataset has plain numbers. Otherwise the dataset is an enumeration:
  /// enumerators[i] is the name of the value i, and `type` must be kUint8.
  std::vector<std::string> enumerators;
  std::vector<std::byte> data;  ///< row by row, in the machine's byte order
};

/// A file whose root group contains all datasets. Only bytes() reports errors. It reports errors of
/// earlier calls of the other functions, too.
class Hdf5File {
 public:
  Hdf5File();
  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;
  ~Hdf5File();

  /// Adds a dataset, stored in compressed chunks (blocks of rows). The table must have at
  /// least one row.
  void add(const Hdf5Table& table);
  /// Adds an attribute to a dataset or to the root group. Its value is a text or a list of texts.
  /// `object`: the name of the dataset, or "/" for the root group.
  void set_attribute(const std::string& object, const std::string& name, const std::string& text);
  void set_attribute(const std::string& object, const std::string& name,
                     std::span<const std::string> texts);
  /// Returns the file's bytes. Errors: kBug if a call of libhdf5 has failed.
  Result<std::vector<std::uint8_t>> bytes();

 private:
  std::int64_t file_ = -1;  ///< libhdf5's identifier
  bool has_failed_ = false;
};

/// The version of libhdf5, such as "1.10.8".
std::string hdf5_version();

}  // namespace trocar::runtime
