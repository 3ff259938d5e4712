// SPDX-License-Identifier: GPL-3.0-or-later
// Calls functions of Intel's library ISA-L and then clears the upper halves of the vector
// registers. ISA-L 2.30 leaves the upper halves in use, because its code for AVX2 and AVX-512 has
// no vzeroupper. All later SSE code of the thread would then be slow: after a .nii.gz was read,
// contours and simplification took 1.35 to 1.65 times as long.
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
