// SPDX-License-Identifier: Apache-2.0
// The de-identification check. It decides whether an asset holds anything, apart from its meshes,
// that could identify the patient from whose scan the asset was made.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar {

/// Returns true if a material may have this name in a de-identified asset. Such a name consists of
/// 1 to 64 ASCII letters, digits, spaces and characters of "_-+,/()". It has no five digits in a
/// row. This excludes dates, patient numbers, paths with dots and UIDs. Each word of two or more
/// letters must be in a list of terms of anatomy, implants and position (deidentification.cpp),
/// whatever its case. This excludes names of persons.
bool is_plain_name(std::string_view name);

/// Checks that `glb` is an asset of schema 2 as encode_asset() writes it, and that all of these
/// conditions hold:
///  1. Every path in the JSON is one that assets have. Every string is an extension, the program
///     and its version, a parameter's choice, the statement of use, a material's name that passes
///     is_plain_name(), or the digest of the input with the user's key.
///  2. The JSON text has no characters that its contents do not need, such as spaces between
///     elements (except the padding at its end) or escapes, and no object has a key twice.
///  3. Every byte of the binary chunk belongs to the slice index, a Draco payload, lines or a
///     volume of HU, or to padding of at most 3 zero bytes.
///  4. The file has no further chunk.
///  5. No volume holds the HU of everything around the material, which can show a face.
/// The values of numbers are not checked, and other defects are not detected: call decode_asset(),
/// too. Errors: kRefused; the message has the file and the first violation.
Result<void> check_deidentified_asset(std::span<const std::uint8_t> glb, const std::string& name);

}  // namespace trocar
