// SPDX-License-Identifier: GPL-3.0-or-later
// Decodes JPEG 2000 with OpenJPEG, since DCMTK has no decoder for it.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::pipeline {

struct Jpeg2000 {
  std::vector<std::int32_t> samples;  ///< row by row
  bool is_signed = false;
};

/// Decodes a codestream with one component of up to 16 bits. It must not have the header of a JP2
/// file. `name` is the input's name in error messages. Errors: kRefused if the bytes are not such a
/// codestream, if the size is not width x height, or if the codestream is damaged.
Result<Jpeg2000> decode_jpeg2000(std::span<const std::uint8_t> codestream, int width, int height,
                                 const std::string& name);

}  // namespace trocar::pipeline
