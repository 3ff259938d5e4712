// SPDX-License-Identifier: Apache-2.0
// Converts a recording to an HDF5 file. Each quantity becomes one dataset, whose attributes state
// unit and frame (docs/hdf5.md).
// Tests: tests/e2e/hdf5_export_test.py
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

struct RecordingHdf5 {
  std::vector<std::uint8_t> bytes;
  std::size_t ticks = 0, datasets = 0;  ///< number of rows, number of datasets
};

/// Converts `csv`, the text of a recording. Every number keeps all its bits. If the recording lacks
/// a column, because an older version of Trocar wrote it, the file lacks the column's dataset.
/// Errors: those of parse_recording(), with `name` in the message; those of Hdf5File::bytes(); kBug
/// if the recording has a column that recording_hdf5.cpp does not know.
Result<RecordingHdf5> recording_hdf5(std::string_view csv, const std::string& name);

}  // namespace trocar::runtime
