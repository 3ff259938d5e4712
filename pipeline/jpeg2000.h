// SPDX-License-Identifier: GPL-3.0-or-later
// JPEG 2000 by OpenJPEG: DCMTK has no decoder of its own for it.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "formats/result.h"

namespace trocar::pipeline {

/// The samples of a codestream of one component of up to 16 bits, row by row, each in the low bits
/// of its word (two's complement if the codestream is signed). `name` is used in messages.
/// Errors (refused): not a bare codestream, another size than width x height, damaged.
Result<std::vector<std::uint16_t>> decode_jpeg2000(std::span<const std::uint8_t> codestream,
                                                   int width, int height, const std::string& name);

}  // namespace trocar::pipeline
