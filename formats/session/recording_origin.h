// SPDX-License-Identifier: Apache-2.0
// What a recording was made with: the program's version, digests of scene, asset and device
// description, and the options that torques depend on. In the CSV it is the text of the column
// `origin` in the first row: "program=0.2.0;scene=DIGEST;...", without commas, quotes or blanks.
#pragma once

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

struct RecordingOrigin {
  std::vector<std::pair<std::string, std::string>> entries;  ///< key, value; empty: not known

  /// Null: there is none.
  const std::string* find(std::string_view key) const;
  friend bool operator==(const RecordingOrigin&, const RecordingOrigin&) = default;
};

/// Characters of keys and values: letters, digits, '.', '_', '+', '-', '/'.
std::string to_text(const RecordingOrigin& origin);

/// Refused: text that to_text() does not give, an empty key, a repeated key, more than 4096
/// characters. Empty text: nothing is known.
Result<RecordingOrigin> parse_origin(std::string_view text);

/// What differs between a recording's origin and that of a run, apart from the program: "the scene
/// (12345678..., here 9abcdef0...), passivity (on, here off)". Empty: nothing. A key that the
/// recording does not have is of a later version and does not count.
std::string differences(const RecordingOrigin& recorded, const RecordingOrigin& run);

}  // namespace trocar
