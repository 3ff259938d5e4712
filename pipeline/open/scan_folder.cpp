// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/open/scan_folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <deque>
#include <iterator>
#include <map>
#include <set>
#include <system_error>
#include <utility>

#include "formats/base/file_descriptor.h"
#include "formats/base/system_message.h"
#include "pipeline/read/dicom/dicomdir.h"
#include "pipeline/read/file_names.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

// Has the file a name that no slice has? If such a file cannot be read, no slice is lost.
bool is_document(const fs::path& file) {
  return is_left_by_system(file) ||
         has_ending(file, {".txt", ".pdf", ".json", ".xml", ".htm", ".html", ".csv", ".tsv", ".md",
                           ".log", ".doc", ".docx", ".glb", ".exe", ".dll", ".inf"});
}

std::string first_names(const std::vector<fs::path>& files) {
  std::string out;
  for (std::size_t i = 0; i < std::min<std::size_t>(files.size(), 2); ++i)
    out += (i == 0 ? "" : ", ") + files[i].filename().string();
  return out + (files.size() > 2 ? ", ..." : "");
}

// Folders of file systems, which their users cannot read. No scan is in them.
bool is_of_file_system(const fs::path& folder) {
  const std::string name = folder.filename().string();
  return name == "lost+found" || name == "System Volume Information" || name == "$RECYCLE.BIN";
}

// Does this error mean that there is nothing at the end of a link?
bool is_broken_link(const std::error_code& error) {
  return error == std::errc::no_such_file_or_directory || error == std::errc::not_a_directory ||
         error == std::errc::too_many_symbolic_link_levels;
}

bool same_folder(const fs::path& a, const fs::path& b) {
  return (a / "").lexically_normal() == (b / "").lexically_normal();
}

// Searches breadth first and follows links to folders last. So a folder that lies below the first
// folder is listed by its own path, not by a link to it.
class Search {
 public:
  Search(const SearchLimits& limits, std::vector<Warning>& warnings)
      : limits_(limits), warnings_(warnings) {}

  Result<std::vector<fs::path>> run(const fs::path& folder) {
    folders_.push_back({folder, 0});
    while (!folders_.empty() || !links_.empty()) {
      std::deque<Folder>& queue = folders_.empty() ? links_ : folders_;
      const Folder next = queue.front();
      queue.pop_front();
      if (!is_new(next.path)) continue;
      if (next.depth > limits_.depth) {
        warnings_.push_back(
            {"folder_left_out", next.path.string(),
             "more than " + std::to_string(limits_.depth) + " folders deep; not searched"});
        continue;
      }
      if (auto ok = list(next); !ok) return ok.error();
    }
    std::sort(files_.begin(), files_.end(), natural_less);
    return std::move(files_);
  }

 private:
  struct Folder {
    fs::path path;
    int depth;
  };

  bool is_new(const fs::path& folder) {
    struct stat status {};
    return ::stat(folder.c_str(), &status) != 0 ||
           seen_.emplace(status.st_dev, status.st_ino).second;
  }

  static Error out_of_reach(const fs::path& path, const std::error_code& error) {
    return refused_for_now(path.string() + ": " + error.message() +
                           "; run again when all of the folder can be read");
  }

  Result<void> list(const Folder& folder) {
    std::error_code error;
    fs::directory_iterator entry(folder.path, error);
    for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
      if (++entries_ > limits_.entries) {
        return refused(folder.path.string() + ": more than " + std::to_string(limits_.entries) +
                       " files and folders up to here; give the folder of one study");
      }
      if (entry->path().filename().string().front() == '.') continue;
      std::error_code unknown, ignored;  // unknown: why it is not known what the entry is
      const bool is_folder = entry->is_directory(unknown);
      if (limits_.must_reach_all && unknown && !is_broken_link(unknown))
        return out_of_reach(entry->path(), unknown);
      if (is_folder) {
        (entry->is_symlink(ignored) ? links_ : folders_)
            .push_back({entry->path(), folder.depth + 1});
      } else if (unknown || entry->is_regular_file(ignored)) {
        files_.push_back(entry->path());
      }
    }
    if (!error) return {};
    if (folder.depth > 0 && is_of_file_system(folder.path)) {
      warnings_.push_back(
          {"folder_left_out", folder.path.string(), error.message() + "; not searched"});
      return {};
    }
    if (folder.depth > 0 && limits_.must_reach_all) return out_of_reach(folder.path, error);
    return refused_by_system(folder.path.string(), error.value());
  }

  SearchLimits limits_;
  std::vector<Warning>& warnings_;
  std::deque<Folder> folders_, links_;
  std::set<std::pair<dev_t, ino_t>> seen_;
  std::vector<fs::path> files_;
  std::size_t entries_ = 0;
};

// The path without what differs between a DICOMDIR and a mounted disk: upper and lower case, and the
// version that ISO 9660 adds (";1").
std::string plain_path(const fs::path& path) {
  std::string out = lower(path.lexically_normal().generic_string());
  if (const auto at = out.find(';'); at != std::string::npos) out.resize(at);
  while (out.ends_with('.'))
    out.pop_back();
  return out;
}

// Warns of images that a DICOMDIR among the files names, and which are not among them. Its paths may
// begin at another folder than its own: some programs write them so, and a DICOMDIR may be moved.
void warn_of_missing(const std::vector<fs::path>& files, std::vector<Warning>& warnings) {
  std::multimap<std::string, std::string> present;  // paths by the file's name
  for (const fs::path& file : files) {
    if (!is_dicomdir(file) || !has_dicom_preamble(file)) continue;
    for (std::size_t i = 0; i < files.size() && present.size() < files.size(); ++i)
      present.emplace(plain_path(files[i].filename()), "/" + plain_path(files[i]));
    std::vector<fs::path> missing = images_of_dicomdir(file);
    std::erase_if(missing, [&](const fs::path& image) {
      const auto [first, last] = present.equal_range(plain_path(image.filename()));
      const std::string end = "/" + plain_path(image);
      return std::any_of(first, last, [&](const auto& one) { return one.second.ends_with(end); });
    });
    if (missing.empty()) continue;
    warnings.push_back({"missing_file", file.string(),
                        "names " + std::to_string(missing.size()) +
                            (missing.size() == 1 ? " image that is" : " images that are") +
                            " not in the folder: " + first_names(missing)});
  }
}

}  // namespace

Result<void> check_readable(const fs::path& file) {
  const FileDescriptor opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  char first = 0;
  if (opened.get() >= 0 && ::pread(opened.get(), &first, 1, 0) >= 0) return {};
  const int error = errno;
  if (opened.get() >= 0 && (error == EISDIR || error == ESPIPE)) return {};  // a folder, a pipe
  std::error_code ignored;
  const bool leads_nowhere = (error == ENOENT || error == ELOOP || error == ENOTDIR) &&
                             fs::is_symlink(fs::symlink_status(file, ignored));
  Error refusal = refused_by_system(file.string(), error);
  if (leads_nowhere) refusal.message += " (a link that leads nowhere)";
  return refusal;
}

std::optional<fs::path> folder_of_dicomdir(const fs::path& file) {
  if (!is_dicomdir(file) || !has_dicom_preamble(file)) return {};
  return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

Result<std::vector<fs::path>> files_below(const fs::path& folder, std::vector<Warning>& warnings,
                                          const SearchLimits& limits) {
  return Search(limits, warnings).run(folder);
}

ScanFolder::Kind ScanFolder::kind() const {
  const auto is_slice = [](const DicomFile& file) {
    return file.kind == DicomFile::Kind::kImages || file.kind == DicomFile::Kind::kSegmentation ||
           (file.kind == DicomFile::Kind::kUnusable && !file.is_capture);
  };
  if (std::any_of(dicom.begin(), dicom.end(), is_slice)) return Kind::kDicom;
  if (!volumes.empty()) return Kind::kVolume;
  if (!images.empty()) return Kind::kImages;
  const bool is_dicom = std::any_of(dicom.begin(), dicom.end(), [](const DicomFile& file) {
    return file.kind != DicomFile::Kind::kNotImage;
  });
  return is_dicom ? Kind::kDicom : Kind::kNothing;
}

bool ScanFolder::has_own_images() const {
  return !images.empty() && same_folder(images[0][0].parent_path(), folder);
}

std::string ScanFolder::left_out(bool with_names) const {
  const Kind taken = kind();
  std::string out;
  const auto add = [&](const std::vector<fs::path>& files, const std::string& what) {
    if (files.empty()) return;
    out += (out.empty() ? "" : ", ") + std::to_string(files.size()) + " " + what +
           (files.size() == 1 ? "" : "s") + (with_names ? " (" + first_names(files) + ")" : "");
  };
  if (taken == Kind::kDicom) add(volumes, format_of_volumes(volumes) + " file");
  std::vector<fs::path> others;
  for (std::size_t i = taken == Kind::kImages ? 1 : 0; i < images.size(); ++i)
    others.insert(others.end(), images[i].begin(), images[i].end());
  if (taken != Kind::kNothing) add(others, "image");
  return out;
}

Result<ScanFolder> search_folder(const fs::path& folder, DicomExtent extent,
                                 const OpenOptions& options, std::vector<Warning>& warnings) {
  const auto files = files_below(folder, warnings);
  if (!files) return files.error();
  if (files->empty()) return refused(folder.string() + ": an empty folder");
  std::optional<Error> unreadable;
  std::size_t others = 0;  // unreadable files after the first
  ScanFolder out;
  out.folder = folder;
  out.where = (folder / "").string();
  std::map<fs::path, std::vector<fs::path>> images;
  for (const fs::path& file : *files) {
    const bool is_slice = has_dicom_preamble(file);
    if (!is_slice && is_volume(file)) {
      out.volumes.push_back(file);
    } else if (!is_slice && is_image(file)) {
      images[file.parent_path()].push_back(file);
    } else if (is_slice || (may_be_dicom(file) && !is_left_by_system(file))) {
      out.dicom.push_back(
          read_dicom_headers(file, options.spacing_mm, options.any_modality, extent));
    } else if (auto ok = check_readable(file); ok) {
      DicomFile other;
      other.file = file;
      out.dicom.push_back(std::move(other));
    } else if (is_document(file)) {
      warnings.push_back({"not_read", file.string(),
                          "cannot be read; left out, as its name is not that of a slice"});
    } else if (!unreadable) {
      unreadable = ok.error();
    } else {
      ++others;
    }
  }
  if (unreadable) {
    if (others > 0)
      unreadable->message += " (and " + std::to_string(others) +
                             (others == 1 ? " more file" : " more files") + " that cannot be read)";
    return *unreadable;
  }
  warn_of_missing(*files, warnings);
  for (auto& [parent, group] : images) {
    const bool is_own = same_folder(parent, folder);
    out.images.insert(is_own ? out.images.begin() : out.images.end(), std::move(group));
  }
  return out;
}

}  // namespace trocar::pipeline
