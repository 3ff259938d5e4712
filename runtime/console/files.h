// SPDX-License-Identifier: Apache-2.0
// The scenes, assets and recordings that pages may name: those of a folder, or those of the command
// line. Whoever writes them is not trusted.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The folder is searched two levels deep; links are not followed. Of one thread at a time, apart
/// from find().
class Files {
 public:
  /// Refused: it is no folder.
  static Result<Files> of_folder(const std::filesystem::path& folder);
  /// For playback, under their last names; `against` may be empty.
  static Files of_recording(const std::filesystem::path& recording,
                            const std::filesystem::path& against,
                            const std::filesystem::path& scene);

  /// The regular file of that name (as in list()). Refused: a name that leads out of the folder,
  /// also by a link, or to no file.
  Result<std::filesystem::path> find(std::string_view name) const;
  /// Empty: playback.
  const std::filesystem::path& folder() const noexcept { return folder_; }
  /// A JSON object with the keys `scenes`, `assets`, `recordings` (protocol.md), and `truncated` if
  /// there were more than are shown. What was read before and has neither another size nor another
  /// time is not read again.
  std::string list();

 private:
  struct Known {
    std::uint64_t size = 0;
    std::filesystem::file_time_type time;
    std::string kind;    ///< key of list(); empty: nothing that it shows
    std::string json;    ///< its entry
    std::string digest;  ///< of a scene; of a recording: its scene's
  };
  Known read(const std::filesystem::path& file, const std::string& name) const;

  std::filesystem::path folder_;
  std::map<std::string, std::filesystem::path, std::less<>> fixed_;
  std::map<std::string, Known> known_;
};

/// The JSON text of a .glb. Refused: it is no binary glTF, or the text exceeds 64 MiB.
Result<std::string> glb_json(const std::filesystem::path& file);

/// Does the asset with this JSON text have a surface for display?
bool has_surface(std::string_view glb_json);

}  // namespace trocar::runtime
