// SPDX-License-Identifier: GPL-3.0-or-later
// The functions of ISA-L that are used. Version 2.30 leaves the upper halves of the vector
// registers in use, because its code for AVX2 and AVX-512 has no vzeroupper. This slows down all
// later SSE code of the thread: after a .nii.gz, contours and simplification took 1.35 to 1.65
// times as long. The functions below clear the registers after each call.
#pragma once

#include <isa-l/igzip_lib.h>

#include <cstdint>
#include <span>

namespace trocar::pipeline {

/// Calls isal_inflate().
int inflate_on(inflate_state& state);
/// Calls crc32_gzip_refl(), which computes the checksum of gzip and PNG.
std::uint32_t gzip_checksum(std::span<const std::uint8_t> bytes);

}  // namespace trocar::pipeline
