// SPDX-License-Identifier: Apache-2.0
// The files that the console serves: those of its page, and scenes, assets and recordings.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::runtime {

// The files of the console's page, which are read once when the console starts, and the policies
// that tell a browser which scripts may run (Content-Security-Policy).

struct PageFile {
  std::string type;  ///< value of the header Content-Type
  std::string bytes;
};

class PageFiles {
 public:
  /// Reads the page's files in `folder` and in its subfolders hand/, imaging/, planning/, view/ and
  /// vendor/: at most 64 files of at most 8 MiB each. vendor/ holds the JavaScript libraries. If it
  /// is empty, the page only says how to get the libraries. Errors: kRefused if there is no
  /// index.html, or if there are more or larger files.
  static Result<PageFiles> read(const std::filesystem::path& folder);
  /// Returns the file for the path of a request, such as "/" or "/vendor/uPlot.esm.js". Returns
  /// null if there is no such file.
  const PageFile* find(std::string_view target) const;
  /// Returns the page's Content-Security-Policy. It allows every script file of this server. It
  /// also lists the hashes of the inline scripts that may run: the page's import map, and the
  /// scripts of the session report and of the history of sessions, which appear in frames.
  const std::string& security_policy() const noexcept { return policy_; }

 private:
  std::map<std::string, PageFile, std::less<>> files_;
  std::string policy_;
};

/// Returns the folder with the page's files. If the program is installed in PREFIX/bin, this is
/// PREFIX/share/trocar/console. Otherwise it is the folder runtime/console/page of the sources.
std::filesystem::path page_folder();

/// The Content-Security-Policy of session reports and of the history of sessions. Others may have
/// changed the reports in the console's folder. Therefore only the scripts that this version of
/// Trocar writes into these pages may run.
const std::string& report_policy();

/// Returns the hashes of the scripts in an HTML page that have the opening tag `tag`, such as
/// "<script>". Before each hash is a blank, and each hash has the form 'sha256-HASH' of a
/// Content-Security-Policy.
std::string script_hashes(std::string_view html, std::string_view tag);

// The scenes, assets and recordings that pages may name. The files are those of a folder or, for
// playback, those that were given on the command line. The contents of the files are not trusted.

/// Lists and finds the files of two folders: the console's folder with scenes and assets, and the
/// folder of sessions. Links are not followed. The names of files in the console's folder are
/// relative to this folder. The names of files in the folder of sessions begin with "sessions/",
/// wherever this folder is. If the folder of sessions is not the subfolder sessions/ of the
/// console's folder, files in that subfolder are found, too, unless the folder of sessions has a
/// file of the same name. A listed name contains at most two folders. Only one thread at a time may
/// call list(); any thread may call find().
class Files {
 public:
  /// Uses the files of a folder. `sessions`: the folder of sessions, which need not exist yet. If
  /// `sessions` is empty, the folder of sessions is the subfolder sessions/ of `folder`. Errors:
  /// kRefused if `folder` is not a folder; kUnwritable if the path `sessions` cannot be resolved.
  static Result<Files> of_folder(const std::filesystem::path& folder,
                                 const std::filesystem::path& sessions = {});
  /// Uses the files of a playback: a recording, its scene and, unless `against` is empty, a second
  /// recording to compare with. Pages name these files without their folders.
  static Files of_recording(const std::filesystem::path& recording,
                            const std::filesystem::path& against,
                            const std::filesystem::path& scene);

  /// Returns the path of the regular file with this name. The name has the form of the names in
  /// list(), but list() need not contain this name. Errors: kRefused if the name leads out of the
  /// folder, if a link is on the way, or if there is no such file.
  Result<std::filesystem::path> find(std::string_view name) const;
  /// The folder that was given to of_folder(); empty for a playback.
  const std::filesystem::path& folder() const noexcept { return folder_; }
  /// The folder of sessions; empty for a playback.
  const std::filesystem::path& sessions() const noexcept { return sessions_; }
  /// Returns a JSON object with the keys `scenes`, `assets` and `recordings` (protocol.md). At most
  /// 2000 files of each kind are listed, and at most 20,000 entries of a folder are searched. If
  /// files are left out for this reason, the object also has the key `truncated`. A file is read
  /// again only if its size or its modification time has changed since the previous call.
  std::string list();

 private:
  struct Known {
    std::uint64_t size = 0;
    std::filesystem::file_time_type time;
    std::string kind;             ///< key in the list; empty: the file is not listed
    std::string json;             ///< entry in the list
    std::string digest;           ///< digest of the scene, or of a recording's scene
    std::string device;           ///< device of a session's recording; empty: not known
    std::filesystem::path asset;  ///< asset of a scene that can be read
  };
  Known read(const std::filesystem::path& file, const std::string& name) const;

  std::filesystem::path path_of(std::string_view name) const;
  /// Calls inspect(file, name) for each file below `root` that may be listed. Each name begins with
  /// `prefix`. If `root` has more than kMaxInspected entries, stops after this number of entries
  /// and returns false. Otherwise returns true.
  template <typename Inspect>
  bool search(const std::filesystem::path& root, const std::string& prefix, int depth,
              Inspect inspect) const;

  std::filesystem::path folder_, sessions_;
  std::map<std::string, std::filesystem::path, std::less<>> fixed_;
  std::map<std::string, Known> known_;
};

}  // namespace trocar::runtime
