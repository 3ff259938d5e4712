// SPDX-License-Identifier: Apache-2.0
// The provenance of a recording: the program's version, digests of scene, asset and device
// description, the options on which torques depend, and the session's duration if it is not the
// scene's. In the CSV, the first row has the provenance as text in the column `origin`:
// "program=0.2.0;scene=DIGEST;...", without commas, quotes or blanks.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

/// The key of the program's version; all other keys are inputs of the session.
inline constexpr const char* kOriginProgram = "program";
/// Keys whose value is a digest: BLAKE2b-256, hexadecimal, as `b2sum -l 256` gives it.
inline constexpr const char* kOriginScene = "scene";
inline constexpr const char* kOriginAsset = "asset";
inline constexpr const char* kOriginDevice = "device";  ///< a digest, "built-in" or "built-in/NAME"
/// Key and value of the entry for the kind of device. Only recordings of a pose device have it.
inline constexpr const char* kOriginDeviceKind = "device-kind";
inline constexpr const char* kPoseDeviceKind = "pose";
/// Key of an entry that only recordings with the operator's X-ray have. The value "counted" means
/// that the rows have the column `xray`, from which pictures and screening time are counted.
inline constexpr const char* kOriginXray = "xray";

struct RecordingOrigin {
  std::vector<std::pair<std::string, std::string>> entries;  ///< key, value; no entries if unknown

  /// The value of a key, or null.
  const std::string* find(std::string_view key) const;
  /// The value of a key as a number; std::nullopt if the key is missing or has no number as value.
  std::optional<double> number(std::string_view key) const;
  friend bool operator==(const RecordingOrigin&, const RecordingOrigin&) = default;
};

/// The text of a number in an entry: the shortest text from which the same number is read again.
std::string origin_number(double x);

/// The text for the CSV. Precondition: keys and values consist of letters, digits, '.', '_',
/// '+', '-' and '/'.
std::string to_text(const RecordingOrigin& origin);

/// Reads what to_text() wrote; an empty text gives no entries. Errors: kRefused if the text has
/// another form or more than 4096 characters, or if a key is empty or repeated.
Result<RecordingOrigin> parse_origin(std::string_view text);

/// Describes the differences between the origin of a recording and that of a run, such as "the
/// scene (0123456789ab..., here cdef01234567...), passivity (on, here off)". Empty if there are no
/// differences. The program's version is not compared. If the run has a key that the recording does
/// not have, this is a difference only if recording and run name the same version of the program.
/// With different versions it is ignored, because an older program may not have known the key.
std::string differences(const RecordingOrigin& recorded, const RecordingOrigin& run);

}  // namespace trocar
