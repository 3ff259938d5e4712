// SPDX-License-Identifier: Apache-2.0
// The provenance of a recording: the program's version, digests of scene, asset and device
// description, and the options on which torques depend. In the CSV it is the text of the column
// `origin` in the first row: "program=0.2.0;scene=DIGEST;...", without commas, quotes or blanks.
// Tests: tests/formats/session/recording_test.cpp
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
inline constexpr const char* kOriginDevice = "device";  ///< or "built-in"
/// Key of the kind of device, which only recordings of a pose device have; its value.
inline constexpr const char* kOriginDeviceKind = "device-kind";
inline constexpr const char* kPoseDeviceKind = "pose";
/// Key of recordings that have the operator's X-ray; its value is "counted".
inline constexpr const char* kOriginXray = "xray";

struct RecordingOrigin {
  std::vector<std::pair<std::string, std::string>> entries;  ///< key, value; no entries if unknown

  /// The value of a key, or null.
  const std::string* find(std::string_view key) const;
  /// The value of a key as a number; none if it is missing or no number.
  std::optional<double> number(std::string_view key) const;
  friend bool operator==(const RecordingOrigin&, const RecordingOrigin&) = default;
};

/// The text of a number in an entry: the shortest that reads back as the same number.
std::string origin_number(double x);

/// The text for the CSV. Keys and values consist of letters, digits, '.', '_', '+', '-' and '/'.
std::string to_text(const RecordingOrigin& origin);

/// Reads what to_text() wrote; empty text gives no entries. Errors: (refused) other text, an empty
/// or repeated key, more than 4096 characters.
Result<RecordingOrigin> parse_origin(std::string_view text);

/// The differences between the origins of a recording and of a run, apart from the program: "the
/// scene (12345678..., here 9abcdef0...), passivity (on, here off)"; empty if there are none. Keys
/// that the recording lacks are ignored, because an older version may have written it.
std::string differences(const RecordingOrigin& recorded, const RecordingOrigin& run);

}  // namespace trocar
