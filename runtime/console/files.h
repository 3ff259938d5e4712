// SPDX-License-Identifier: Apache-2.0
// The scenes, assets and recordings that pages may name. They are in a folder, or were given on the command line.
// The files are not trusted.
// Tests: tests/runtime/console/console_test.cpp
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

/// Searches the folder two levels deep, without following links. The names of files in the folder of sessions
/// begin with "sessions/", wherever that folder is. Sessions in the folder itself are found, too. Only one thread
/// at a time may call list(); any thread may call find().
class Files {
 public:
  /// Uses the files of a folder. The sessions are in the folder's own sessions/, or in `sessions` if that is not
  /// empty; it need not exist yet. Errors: (refused) `folder` is not a folder.
  static Result<Files> of_folder(const std::filesystem::path& folder,
                                 const std::filesystem::path& sessions = {});
  /// Uses the files of a playback. A page knows them by the last parts of their names. `against` may be empty.
  static Files of_recording(const std::filesystem::path& recording,
                            const std::filesystem::path& against,
                            const std::filesystem::path& scene);

  /// Returns the regular file of that name (as in list()). Errors: (refused) the name leads out of the folder,
  /// also by a link, or to no file.
  Result<std::filesystem::path> find(std::string_view name) const;
  /// The folder; empty for playback.
  const std::filesystem::path& folder() const noexcept { return folder_; }
  const std::filesystem::path& sessions() const noexcept { return sessions_; }
  /// Returns a JSON object with the keys `scenes`, `assets` and `recordings` (protocol.md), and with `truncated`
  /// if there are more files than it lists. A file is read again only if its size or time has changed.
  std::string list();

 private:
  struct Known {
    std::uint64_t size = 0;
    std::filesystem::file_time_type time;
    std::string kind;    ///< key in the list; empty: the file is not listed
    std::string json;    ///< entry in the list
    std::string digest;  ///< digest of the scene, or of the scene that a recording names
    std::string device;  ///< the device of a session's recording, if it is known
  };
  Known read(const std::filesystem::path& file, const std::string& name) const;

  std::filesystem::path path_of(std::string_view name) const;
  /// Calls inspect(file, name) for the files below `root` that may be listed. Their names begin with `prefix`.
  /// Returns false after kMaxInspected entries.
  template <typename Inspect>
  bool search(const std::filesystem::path& root, const std::string& prefix, int depth,
              Inspect inspect) const;

  std::filesystem::path folder_, sessions_;
  std::map<std::string, std::filesystem::path, std::less<>> fixed_;
  std::map<std::string, Known> known_;
};

}  // namespace trocar::runtime
