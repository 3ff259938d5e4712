// SPDX-License-Identifier: Apache-2.0
// The de-identification check. It decides whether an asset holds, apart from its meshes, anything
// that could identify the patient whose scan it was made from.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar {

/// Returns true if a material may have this name in a de-identified asset. Names have 1 to 64 ASCII
/// letters, digits, spaces and _-+,/(), and no five digits in a row, which excludes dates, patient
/// numbers, paths with dots and UIDs. Words of two letters or more must be in a list
/// (deidentification.cpp) of terms of anatomy, of implants and of position, in any case. This
/// excludes names of persons.
bool is_plain_name(std::string_view name);

/// Checks that `glb` is an asset of schema 2 as encode_asset() writes it, and that all
/// of this holds:
///  1. every path in its JSON is one that assets have, and every string is an extension, the
///     program and its version, a parameter's choice, a material's name with is_plain_name(), or
///     the digest of the input with the user's key;
///  2. its JSON has no spaces except the padding, no escapes and no key twice;
///  3. every byte of the binary chunk belongs to the slice index, a Draco payload or a line, or is
///     padding, which is less than 4 zero bytes;
///  4. there is no other chunk.
/// Values of numbers are not checked. decode_asset() detects other defects, so call it too. Errors:
/// (refused) with the file and the first finding.
Result<void> check_deidentified_asset(std::span<const std::uint8_t> glb, const std::string& name);

}  // namespace trocar
