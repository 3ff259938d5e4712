// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/open/scan_folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <deque>
#include <iterator>
#include <system_error>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/dicom/dicom_series.h"
#include "pipeline/read/dicom/dicom_stack.h"
#include "pipeline/read/dicom/dicom_volumes.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/nrrd.h"
#include "pipeline/read/number_ranges.h"

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

namespace fs = std::filesystem;
using nlohmann::json;

json text_or_null(const std::string& text) {
  return text.empty() ? json() : json(text);
}

// The path of the file relative to the listed folder.
std::string path_in(const fs::path& folder, const fs::path& file) {
  return file.lexically_relative(folder).generic_string();
}

// The deepest folder that contains all the files, or the file if there is only one.
fs::path common_path(const std::vector<fs::path>& files) {
  if (files.size() == 1) return files[0];
  fs::path common = files[0].parent_path();
  for (const fs::path& file : files) {
    while (!common.empty() && path_in(common, file).starts_with(".."))
      common = common.parent_path();
  }
  return common;
}

// Removes the folder from the names in a message, because the list has names relative to the
// folder.
std::string without_prefix(std::string message, const std::string& prefix) {
  for (std::size_t at = 0; (at = message.find(prefix, at)) != std::string::npos;)
    message.erase(at, prefix.size());
  return message;
}

json scan_of(const char* kind, const std::string& path) {
  json out = {{"kind", kind}, {"path", path}, {"usable", true}, {"taken", false}};
  for (const char* name :
       {"slices", "width_px", "height_px", "spacing_mm", "evenly_spaced", "tilt_deg", "problem"})
    out[name] = nullptr;
  return out;
}

void add_shape(json& scan, const std::array<double, 2>& spacing_mm, const StackShape& shape) {
  scan["spacing_mm"] = {spacing_mm[0], spacing_mm[1],
                        shape.gaps_mm.empty() ? json() : json(shape.step_mm)};
  if (shape.gaps_mm.empty()) return;
  scan["evenly_spaced"] = !shape.first_uneven();
  scan["tilt_deg"] = shape.is_tilted() ? shape.tilt_deg : 0;
}

// Adds the size of a stack and, if it is known, the spacing.
void add_stack(json& scan, const SliceStack& stack, bool has_spacing) {
  scan["slices"] = stack.size();
  scan["width_px"] = stack.width();
  scan["height_px"] = stack.height();
  if (!has_spacing) return;
  const SlicePlane& plane = stack.plane(0);
  add_shape(scan, {plane.spacing_u_mm, plane.spacing_v_mm}, stack_shape(stack));
}

void set_unusable(json& scan, const std::string& why, const ScanFolder& found) {
  scan["usable"] = false;
  scan["problem"] = without_prefix(why, found.where);
}

// Adds the data of a segmentation, which is a label map and not a CT.
void add_segmentation(json& scan, const DicomFile& file, const ScanFolder& found) {
  scan["segments"] = json::array();
  for (const auto& [label, name] : file.segments.names)
    scan["segments"].push_back({{"label", label}, {"name", text_or_null(name)}});
  const auto stack = open_segmentation(file, {});
  if (!stack) return set_unusable(scan, stack.error().message, found);
  add_stack(scan, **stack, true);
}

// The segmentation in the series; null if there is none, or if it cannot be read.
const DicomFile* segmentation_of(const DicomSeries& series, const ScanFolder& found) {
  const auto file = std::find_if(found.dicom.begin(), found.dicom.end(), [&](const DicomFile& f) {
    return f.kind == DicomFile::Kind::kSegmentation && f.file == series.files[0];
  });
  return file == found.dicom.end() ? nullptr : &*file;
}

// The scans of a series: one or, if it has several volumes, one for each of them.
std::vector<json> series_scans(const std::vector<DicomSeries>& all, std::size_t index,
                               const ScanFolder& found) {
  const DicomSeries& series = all[index];
  const SeriesInfo& info = series.info;
  json out = scan_of("dicom", path_in(found.folder, common_path(series.files)));
  out["uid"] = info.uid;
  out["study_uid"] = text_or_null(info.study_uid);
  out["study_date"] = text_or_null(info.study_date);
  out["number"] = info.number ? json(*info.number) : json();
  out["description"] = text_or_null(info.description);
  out["kernel"] = text_or_null(info.kernel);
  out["modality"] = text_or_null(info.modality);
  out["image_type"] = text_or_null(info.image_type);
  out["localiser"] = series.is_localiser();
  out["files"] = series.files.size();
  out["slices"] = series.is_localiser() ? series.localisers : series.images();

  if (const DicomFile* labels = segmentation_of(series, found)) {
    add_segmentation(out, *labels, found);
    return {out};
  }
  std::vector<Warning> ignored;
  const bool is_other = series.content.kind == ImageContent::Kind::kOther;
  if (series.is_localiser() || (is_other && !series.content.is_segmentation()))
    set_unusable(out, why_not_ct(series.content), found);
  if (series.is_localiser()) return {out};
  auto slices = slices_of(all, {index, {}}, found.where, ignored);
  if (!slices) {
    if (out["usable"] == true) set_unusable(out, slices.error().message, found);
    return {out};
  }
  out["width_px"] = (*slices)[0].columns;
  out["height_px"] = (*slices)[0].rows;
  const auto volumes = volumes_of(std::move(*slices), ignored);
  if (!volumes) {
    set_unusable(out, volumes.error().message, found);
    return {out};
  }
  std::vector<json> scans;
  for (std::size_t i = 0; i < volumes->size(); ++i) {
    const DicomVolume& volume = (*volumes)[i];
    const DicomFrame& first = volume.slices[0];
    scans.push_back(out);
    scans[i]["slices"] = volume.slices.size();
    scans[i]["width_px"] = first.columns;
    scans[i]["height_px"] = first.rows;
    add_shape(scans[i], {first.spacing_u_mm, first.spacing_v_mm}, stack_shape(volume.slices));
    if (volumes->size() == 1) continue;
    scans[i]["volume"] = i;
    scans[i]["volume_name"] = volume.name;
  }
  return scans;
}

json volume_scan(const fs::path& file, const ScanFolder& found) {
  json out = scan_of(is_nrrd(file) ? "nrrd" : "nifti", path_in(found.folder, file));
  OpenOptions options;
  auto stack = open_volume(file, options, true);
  const bool has_size = stack || stack.error().code != ExitCode::kUsage;
  if (!has_size) {
    options.spacing_mm = {1, 1, 1};
    stack = open_volume(file, options, true);
  }
  if (stack)
    add_stack(out, **stack, has_size);
  else
    set_unusable(out, stack.error().message, found);
  return out;
}

// A folder that contains only this file.
ScanFolder only(const fs::path& file) {
  ScanFolder out;
  out.folder = file.parent_path();
  out.where = out.folder.empty() ? "" : (out.folder / "").string();
  if (is_volume(file))
    out.volumes = {file};
  else if (is_image(file))
    out.images = {{file}};
  else
    out.dicom = {read_dicom_headers(file, {}, true, DicomExtent::kHeader)};
  return out;
}

Result<ScanFolder> look_into(const fs::path& input, std::vector<Warning>& warnings) {
  std::error_code error;
  const fs::file_status status = fs::status(input, error);
  if (error && error != std::errc::no_such_file_or_directory)
    return refused(input.string() + ": " + error.message());
  if (!fs::exists(status)) return refused(input.string() + ": no such file or folder");
  fs::path folder = input;
  if (!fs::is_directory(status)) {
    if (!fs::is_regular_file(status)) return refused(input.string() + ": not a regular file");
    if (auto ok = check_readable(input); !ok) return ok.error();
    if (!is_dicomdir(input)) return only(input);
    folder = input.parent_path().empty() ? "." : input.parent_path();
  }
  OpenOptions options;
  options.any_modality = true;  // the shape of images that are not CT is listed, too
  return search_folder(folder, DicomExtent::kHeader, options, warnings);
}

std::string cell(const json& scan, const char* name) {
  const auto value = scan.find(name);
  if (value == scan.end() || value->is_null()) return "-";
  if (value->is_string()) return terminal_text(value->get<std::string>());
  return json_text(*value);
}

std::string spacing_cell(const json& scan) {
  const json& mm = scan["spacing_mm"];
  if (mm.is_null()) return scan["usable"].get<bool>() ? "give --spacing" : "-";
  std::string out;
  for (const json& one : mm)
    out += (out.empty() ? "" : " x ") + (one.is_null() ? "-" : text_of(one.get<double>(), 4));
  if (scan["evenly_spaced"] == false) out += " uneven";
  return out;
}

std::string tilt_cell(const json& scan) {
  return scan["tilt_deg"].is_null() ? "-" : text_line("%.1f", scan["tilt_deg"].get<double>());
}

using TableRow = std::vector<std::string>;

// Columns that only some lists have.
struct Extra {
  bool study = false, volume = false;
};

TableRow row_of(const json& scan, const Extra& with) {
  const std::string kind = scan["kind"].get<std::string>();
  TableRow out = {scan["taken"].get<bool>() ? "*" : " ",
                  cell(scan, "number"),
                  kind == "dicom" ? cell(scan, "modality") : kind,
                  cell(scan, "slices"),
                  spacing_cell(scan),
                  tilt_cell(scan),
                  cell(scan, "kernel"),
                  cell(scan, "description"),
                  cell(scan, "path")};
  if (with.volume) out.insert(out.begin() + 2, cell(scan, "volume"));
  if (with.study) out.insert(out.begin() + 1, cell(scan, "study_date"));
  return out;
}

// The width of a text in columns of a terminal. It is the number of code points, since combining
// marks are rare.
std::size_t letters(const std::string& utf8) {
  return static_cast<std::size_t>(std::count_if(utf8.begin(), utf8.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
  }));
}

std::string aligned(const std::vector<TableRow>& rows) {
  std::vector<std::size_t> width(rows[0].size());
  for (const TableRow& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i)
      width[i] = std::max(width[i], letters(row[i]));
  }
  std::string out;
  for (const TableRow& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string blanks(width[i] - letters(row[i]), ' ');
      const bool is_right = rows[0][i] == "series" || rows[0][i] == "volume" ||
                            rows[0][i] == "slices" || rows[0][i] == "tilt";
      const bool is_last = i + 1 == row.size();
      out += (i == 0 ? "" : i == 1 ? " " : "  ") + (is_right ? blanks + row[i] : row[i]);
      if (!is_right && !is_last) out += blanks;
    }
    out += '\n';
  }
  return out;
}

// "1 L1, 2 L2": the segments of a DICOM segmentation.
std::string segments_of(const json& scan) {
  constexpr std::size_t kMax = 12;
  const json& segments = scan["segments"];
  std::string out;
  for (std::size_t i = 0; i < std::min(segments.size(), kMax); ++i) {
    out += (i == 0 ? "" : ", ") + json_text(segments[i]["label"]);
    if (const std::string name = cell(segments[i], "name"); name != "-") out += " " + name;
  }
  if (segments.size() > kMax) out += " and " + std::to_string(segments.size() - kMax) + " more";
  return out;
}

std::string name_of(const json& scan) {
  std::string path = cell(scan, "path");
  if (scan["kind"] != "dicom" || scan["number"].is_null()) return path;
  return "series " + cell(scan, "number") + " (" + path + ")" +
         (scan.contains("volume") ? " volume " + cell(scan, "volume") : "");
}

// The problem of a scan. If the text begins with the scan's own name, the name is left out.
std::string problem_of(const json& scan) {
  const std::string text = cell(scan, "problem"), name = cell(scan, "path") + ": ";
  return text.starts_with(name) ? text.substr(name.size()) : text;
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

Result<json> list_scans(const fs::path& input, std::vector<Warning>& warnings) {
  const auto found = look_into(input, warnings);
  if (!found) return found.error();
  json scans = json::array(), why;
  std::vector<Warning> ignored;
  const auto series = group_series(found->dicom, ignored);
  const ScanFolder::Kind taken = found->kind();
  Result<ChosenSeries> chosen = ChosenSeries{series.size(), {}};
  if (taken == ScanFolder::Kind::kDicom) chosen = choose_series(series, {}, found->where);
  for (std::size_t i = 0; i < series.size(); ++i) {
    auto of_series = series_scans(series, i, *found);
    // A series of several volumes is not taken without --volume.
    if (chosen && chosen->index == i && of_series.size() == 1) {
      of_series[0]["taken"] = true;
      why = text_or_null(chosen->why);
    }
    std::move(of_series.begin(), of_series.end(), std::back_inserter(scans));
  }
  for (const fs::path& file : found->volumes) {
    scans.push_back(volume_scan(file, *found));
    scans.back()["taken"] = taken == ScanFolder::Kind::kVolume && found->volumes.size() == 1;
  }
  for (const auto& files : found->images) {
    const bool is_folder = files.size() > 1 || files[0] != input;
    scans.push_back(scan_of("images", is_folder ? path_in(found->folder, files[0].parent_path())
                                                : path_in(found->folder, files[0])));
    scans.back()["slices"] = files.size();
    scans.back()["taken"] = taken == ScanFolder::Kind::kImages && &files == &found->images[0] &&
                            (found->has_own_images() || found->images.size() == 1);
  }
  if (scans.empty()) {
    return refused(input.string() +
                   ": contains no DICOM images, NIfTI (.nii, .nii.gz) or NRRD files (.nrrd, .nhdr) "
                   "or images (.png, .tif, "
                   ".bmp, .jpg)");
  }
  const auto others =
      std::count_if(found->dicom.begin(), found->dicom.end(),
                    [](const DicomFile& file) { return file.kind == DicomFile::Kind::kNotImage; });
  const fs::path name = input.has_filename() ? input : input.parent_path();
  return json{{"schema", "trocar.list/1"},
              {"program", "trocar-mesh " TROCAR_VERSION},
              {"folder", name.filename().string()},
              {"other_files", others},
              {"why", std::move(why)},
              {"scans", std::move(scans)}};
}

std::string scan_table(const json& list, const std::string& folder) {
  std::set<std::string> studies;
  for (const json& scan : list["scans"]) {
    if (scan["kind"] == "dicom") studies.insert(cell(scan, "study_uid"));
  }
  const Extra with{studies.size() > 1,
                   std::any_of(list["scans"].begin(), list["scans"].end(),
                               [](const json& scan) { return scan.contains("volume"); })};
  std::vector<TableRow> rows = {
      {" ", "series", "modality", "slices", "spacing mm", "tilt", "kernel", "description", "path"}};
  if (with.volume) rows[0].insert(rows[0].begin() + 2, "volume");
  if (with.study) rows[0].insert(rows[0].begin() + 1, "study");
  constexpr std::size_t kMaxOfImages = 12;  // viewers on CDs have folders of them
  std::size_t images = 0;
  for (const json& scan : list["scans"]) {
    if (scan["kind"] != "images" || ++images <= kMaxOfImages) rows.push_back(row_of(scan, with));
  }
  const std::string shown_folder = terminal_text(folder);
  std::string out = aligned(rows);
  if (images > kMaxOfImages)
    out += "and " + std::to_string(images - kMaxOfImages) + " more folders of images\n";
  for (const json& scan : list["scans"]) {
    if (scan["usable"].get<bool>()) continue;
    out += name_of(scan) + " cannot be used: " + problem_of(scan) + "\n";
  }
  for (const json& scan : list["scans"]) {
    if (scan.contains("segments"))
      out += name_of(scan) + " is a label map, for --labels: " + segments_of(scan) + "\n";
  }
  for (const json& scan : list["scans"]) {
    if (scan.contains("volume"))
      out += name_of(scan) + " is " + cell(scan, "volume_name") + ", for --volume\n";
  }
  const auto taken = std::find_if(list["scans"].begin(), list["scans"].end(),
                                  [](const json& scan) { return scan["taken"].get<bool>(); });
  if (taken == list["scans"].end()) {
    out += "Nothing is taken of " + shown_folder + " as a whole: give one of these by its path" +
           (with.volume ? ", or one volume with --volume\n" : "\n");
  } else if (!list["why"].is_null()) {
    out += "What is taken of " + shown_folder +
           " (*): " + terminal_text(list["why"].get<std::string>()) + "; --series takes another\n";
  }
  return out;
}

Result<void> check_any_usable(const json& list, const std::string& folder) {
  const json& scans = list["scans"];
  if (std::any_of(scans.begin(), scans.end(),
                  [](const json& scan) { return scan["usable"].get<bool>(); }))
    return {};
  return refused(folder + ": nothing usable: " + name_of(scans[0]) + ": " + problem_of(scans[0]));
}

}  // namespace trocar::pipeline
