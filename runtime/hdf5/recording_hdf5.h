// SPDX-License-Identifier: Apache-2.0
// Converts a recording to an HDF5 file: one dataset for each quantity, with units and frames
// as attributes (docs/hdf5.md).
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
  std::size_t ticks = 0, datasets = 0;
};

/// Converts the text of a recording. Every number keeps all its bits. Columns that the recording
/// lacks, because an older version wrote the recording, get no dataset. Errors: those of
/// parse_recording(), with `name` in the message; those of Hdf5File::bytes(); kBug if a column has
/// no entry in the table.
Result<RecordingHdf5> recording_hdf5(std::string_view csv, const std::string& name);

}  // namespace trocar::runtime
