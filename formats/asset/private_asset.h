// SPDX-License-Identifier: Apache-2.0
// Whether an asset holds anything that could tell whose scan it was made from, beside its meshes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar {

/// May a material have this name in a private asset? 1 to 64 letters, digits, spaces and _-+,/()
/// of ASCII, with no five digits in a row: no dates, numbers of patients, paths with dots or UIDs.
bool is_plain_name(std::string_view name);

/// Refused, naming the file and the first thing found, unless `glb` is an asset of schema 2 as
/// encode_asset() writes it and
///  1. every key of its JSON, at its place, is one that assets have, and every string is an
///     extension, the program and its version, a parameter's choice, a material's is_plain_name(),
///     or the digest of the input with the user's key;
///  2. its JSON has no spaces but the padding, no escapes and no key twice;
///  3. every byte of the binary chunk is of the slice index, a Draco payload or a line, or padding:
///     zero, and less than 4 bytes;
///  4. there is no other chunk.
/// Numbers are not judged. decode_asset() finds what else is wrong with the file; call it too.
Result<void> check_private_asset(std::span<const std::uint8_t> glb, const std::string& name);

}  // namespace trocar
