// SPDX-License-Identifier: Apache-2.0
// The de-identification check refuses an asset with data by which the patient could be identified.
// The geometry and the HU near the material are always allowed.
#pragma once

#include <cstdint>
#include <set>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar {

/// Returns true if a material may have this name in a de-identified asset. Such a name has 1 to 64
/// ASCII letters, digits, spaces and characters of "_-+,/()". Each run of letters and digits is one
/// of these:
///  - A word of the list in deidentification.cpp (terms of anatomy, implants and position), in upper
///    or lower case, also with a number behind it. So names of persons are excluded.
///  - A level of the spine, such as "L3" or "T12".
///  - L or R, at most once before the next plus sign. Other single letters could spell a name.
///  - A number. All numbers of the name together have at most four digits, so that they are no date
///    and no patient's number. This does not count numbers in `labels`, the labels from which the
///    asset was made, nor the numbers 1 to 13 behind "rib".
bool is_plain_name(std::string_view name, const std::set<std::int64_t>& labels = {});

/// Returns true if the text is a modality of images that DICOM defines (PS3.3, C.7.3.1.1.1), such
/// as "CT". Any other text could be a name.
bool is_modality(std::string_view text);

/// The text by which assets and reports name the modality of a scan whose values are not HU. If
/// `text` is a modality of images that DICOM defines, alone or followed by one of a few fixed words
/// for the kind of image ("LOCALIZER") or of values ("ED", electron density), the result is `text`.
/// Otherwise it is "OT" (other), because `text` could be a name.
std::string shared_modality(std::string_view text);

/// Checks that `glb` is an asset of schema 2 as encode_asset() writes it, and that all of these
/// conditions hold:
///  1. Every key of the JSON is one that assets have at this position. Every string is a term of
///     glTF, the program and its version, one of a parameter's fixed values (such as "coronal"), a
///     modality that shared_modality() leaves as it is, the statement of use, the keyed digest of
///     the input, or a material's name that passes is_plain_name().
///  2. The JSON text has no characters that its contents do not need, such as escapes or spaces
///     between elements; only padding at its end is allowed. No object has a key twice.
///  3. Every byte of the binary chunk belongs to the slice index, a Draco payload, lines or a
///     volume of HU, or to padding of at most 3 zero bytes. Every node, mesh, accessor and buffer
///     view is used by a scene or by a volume of HU.
///  4. The file has no further chunk.
///  5. No volume holds the HU of everything around the material, which can show a face.
/// Values of numbers are not checked, and whether the asset can be decoded is not checked either:
/// call decode_asset(), too. Errors: kRefused; the message has the file and the first violation.
Result<void> check_deidentified_asset(std::span<const std::uint8_t> glb, const std::string& name);

}  // namespace trocar
