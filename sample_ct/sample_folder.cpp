// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/sample_folder.h"

#include <fcntl.h>
#include <spng.h>
#include <unistd.h>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "sample_ct/write_dicom.h"
#include "sample_ct/write_nifti.h"

namespace trocar::sample {

std::string png_name(int k) {
  return text_line("slice_%03d.png", k + 1);
}

namespace {

struct Freed {
  void operator()(spng_ctx* context) const { spng_ctx_free(context); }
  void operator()(std::uint8_t* bytes) const { std::free(bytes); }
};

// A PNG of `size` bytes with three bytes for each pixel; null on failure.
std::unique_ptr<std::uint8_t, Freed> encode(std::span<const std::uint8_t> pixels, int rows,
                                            int columns, std::size_t& size) {
  const std::unique_ptr<spng_ctx, Freed> png(spng_ctx_new(SPNG_CTX_ENCODER));
  spng_ihdr header{};
  header.width = static_cast<std::uint32_t>(columns);
  header.height = static_cast<std::uint32_t>(rows);
  header.bit_depth = 8;
  header.color_type = SPNG_COLOR_TYPE_TRUECOLOR;
  int error = png ? spng_set_option(png.get(), SPNG_ENCODE_TO_BUFFER, 1) : SPNG_EMEM;
  // On grey noise, this level packs no worse than zlib's default, and the sub filter alone no worse
  // than a filter chosen for each row. Both are faster.
  if (error == 0) error = spng_set_option(png.get(), SPNG_IMG_COMPRESSION_LEVEL, 3);
  if (error == 0) error = spng_set_option(png.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB);
  if (error == 0) error = spng_set_ihdr(png.get(), &header);
  if (error == 0)
    error = spng_encode_image(png.get(), pixels.data(), pixels.size(), SPNG_FMT_PNG,
                              SPNG_ENCODE_FINALIZE);
  if (error != 0) return nullptr;
  return std::unique_ptr<std::uint8_t, Freed>(
      static_cast<std::uint8_t*>(spng_get_png_buffer(png.get(), &size, &error)));
}

namespace fs = std::filesystem;

Error failed(const fs::path& path, const std::error_code& reason) {
  return unwritable(path.string() + ": " + reason.message());
}
std::error_code last_error() {
  return {errno, std::generic_category()};
}

bool is_set(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load();
}
Error interrupted() {
  return unwritable("interrupted; nothing was written");
}

enum class Removal { kWithContents, kIfEmpty };

/// Removes the folder when this object goes out of scope. An empty path means no folder.
struct RemovedAtEnd {
  fs::path path;
  Removal removal;
  RemovedAtEnd(fs::path folder, Removal how) : path(std::move(folder)), removal(how) {}
  RemovedAtEnd(const RemovedAtEnd&) = delete;
  RemovedAtEnd& operator=(const RemovedAtEnd&) = delete;
  ~RemovedAtEnd() {
    std::error_code ignored;
    if (removal == Removal::kWithContents) fs::remove_all(path, ignored);
    if (removal == Removal::kIfEmpty) fs::remove(path, ignored);
  }
};

/// Replaces the name of a file in the scratch folder by the file's final name in the error's
/// message.
Error named_after(Error error, const fs::path& scratch, const fs::path& folder) {
  const std::size_t at = error.message.find(scratch.string());
  if (at != std::string::npos) error.message.replace(at, scratch.string().size(), folder.string());
  return error;
}

Result<void> sync_folder(const fs::path& folder) {
  const FileDescriptor opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (opened.get() < 0 || ::fsync(opened.get()) != 0) return failed(folder, last_error());
  return {};
}

/// Fails unless the folder is absent, empty, or has only files of this name pattern.
Result<void> check_replaceable(const fs::path& folder, const char* pattern) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(folder, error);
  if (status.type() == fs::file_type::not_found) return {};
  if (error) return failed(folder, error);
  if (status.type() != fs::file_type::directory)
    return unwritable(folder.string() + ": exists and is not a folder");
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (!matches(it->path().filename().string(), pattern))
      return unwritable(folder.string() + ": holds " + it->path().filename().string() +
                        ", which is not from an earlier run; the folder is not replaced");
  if (error) return failed(folder, error);
  return {};
}

/// Moves `made` to `target`; exchanges it with an existing file or folder.
Result<void> move_or_exchange(const fs::path& made, const fs::path& target) {
  if (::rename(made.c_str(), target.c_str()) == 0) return {};
  // A folder that is not empty must be exchanged. The old one is removed with the scratch folder.
  if (errno != ENOTEMPTY && errno != EEXIST) return failed(target, last_error());
  if (::renameat2(AT_FDCWD, made.c_str(), AT_FDCWD, target.c_str(), RENAME_EXCHANGE) == 0)
    return {};
  if (errno != EINVAL && errno != ENOSYS) return failed(target, last_error());
  // If the file system cannot exchange, move the old one away, then rename the new one.
  const fs::path old = made.string() + ".old";
  if (::rename(target.c_str(), old.c_str()) != 0) return failed(target, last_error());
  if (::rename(made.c_str(), target.c_str()) == 0) return {};
  const std::error_code reason = last_error();
  ::rename(old.c_str(), target.c_str());
  return failed(target, reason);
}

// The text of sample.json: the scan's parameters, every length with its unit.
std::string describe_scan(const Scan& scan, const GreyWindow& window) {
  const ScanGeometry& g = scan.geometry;
  const TissueHu tissue;
  const nlohmann::ordered_json json{
      {"program", "trocar-sample-ct " TROCAR_VERSION},
      {"seed", scan.seed},
      {"slices", g.slices},
      {"columns", g.columns},
      {"rows", g.rows},
      {"frame",
       "LPS, z up; pixel (column, row) of slice k lies at first_pixel_mm + (column * "
       "spacing[0], row * spacing[1], k * spacing[2])"},
      {"spacing_mm", {g.pixel_mm, g.pixel_mm, g.slice_step_mm}},
      {"first_pixel_mm", {g.first_pixel_mm.x, g.first_pixel_mm.y, g.first_pixel_mm.z}},
      {"slice_thickness_mm", g.slice_thickness_mm},
      {"noise_HU", scan.noise_hu},
      {"png_window_HU", {window.low_hu, window.high_hu}},
      {"cortical_HU", tissue.cortical},
      {"cancellous_HU", tissue.cancellous},
      {"files",
       {{"png", png_name(0) + " .. " + png_name(g.slices - 1)},
        {"dicom", dicom_name(0) + " .. " + dicom_name(g.slices - 1)},
        {"nifti", "sample.nii.gz"}}},
  };
  return json_text(json, 2) + "\n";
}

}  // namespace

Result<void> write_png(const Scan& scan, const GreyWindow& window,
                       const std::filesystem::path& folder) {
  if (!(window.high_hu > window.low_hu))
    return usage("the upper end of the grey window must be above its lower end");
  const int rows = scan.geometry.rows, columns = scan.geometry.columns;
  std::vector<std::uint8_t> grey(kMaxHu - kMinHu + 1);
  for (int hu = kMinHu; hu <= kMaxHu; ++hu) {
    const double level = (hu - window.low_hu) / (window.high_hu - window.low_hu) * 255;
    grey[hu - kMinHu] = static_cast<std::uint8_t>(std::lround(std::clamp(level, 0.0, 255.0)));
  }
  std::vector<std::uint8_t> pixels(std::size_t{3} * rows * columns);
  for (int k = 0; k < scan.geometry.slices; ++k) {
    const std::int16_t* hu = scan.slice(k);
    for (std::size_t i = 0; i < pixels.size(); i += 3, ++hu)
      std::fill_n(&pixels[i], 3, grey[*hu - kMinHu]);
    const std::filesystem::path file = folder / png_name(k);
    std::size_t size = 0;
    const auto bytes = encode(pixels, rows, columns, size);
    if (!bytes) return unwritable(file.string() + ": the PNG encoder failed");
    if (const Result<void> written = write_file_atomically(file, {bytes.get(), size}); !written)
      return written.error();
  }
  return {};
}

std::string png_library_version() {
  return std::string("libspng ") + spng_version_string();
}
Result<void> check_sample_folder(const fs::path& folder) {
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error))
    return unwritable(folder.string() + ": exists and is not a folder");
  fs::path existing = folder;  // or the nearest existing folder above it
  while (!existing.empty() && !fs::exists(existing, error))
    existing = existing.parent_path();
  if (existing.empty()) existing = ".";
  if (!fs::is_directory(existing, error))
    return failed(folder, std::make_error_code(std::errc::not_a_directory));
  if (::access(existing.c_str(), W_OK | X_OK) != 0) return failed(folder, last_error());
  for (const auto& [name, pattern] :
       {std::pair{"png", R"(slice_[0-9]{3}\.png)"}, std::pair{"dicom", R"(CT_[0-9]{3}\.dcm)"}})
    if (Result<void> fit = check_replaceable(folder / name, pattern); !fit) return fit;
  return {};
}

Result<void> write_sample_folder(const Scan& scan, const GreyWindow& window, const fs::path& folder,
                                 const std::function<void(const std::string&)>& progress,
                                 const std::atomic<bool>* stop) {
  if (is_set(stop)) return interrupted();
  if (Result<void> good = check_sample_folder(folder); !good) return good;
  std::error_code error;
  const RemovedAtEnd unless_filled{fs::exists(folder, error) ? fs::path() : folder,
                                   Removal::kIfEmpty};
  fs::create_directories(folder, error);
  if (error) return failed(folder, error);

  const RemovedAtEnd scratch(folder / (".trocar-sample-ct." + std::to_string(::getpid())),
                             Removal::kWithContents);
  fs::remove_all(scratch.path, error);
  for (const fs::path& made : {scratch.path, scratch.path / "png", scratch.path / "dicom"}) {
    fs::create_directory(made, error);
    if (error) return failed(folder, error);
  }

  using Writer = std::function<Result<void>()>;
  const std::pair<const char*, Writer> writers[] = {
      {"writing PNG", [&] { return write_png(scan, window, scratch.path / "png"); }},
      {"writing DICOM", [&] { return write_dicom(scan, scratch.path / "dicom"); }},
      {"writing NIfTI", [&] { return write_nifti(scan, scratch.path / "sample.nii.gz"); }},
      {"writing sample.json", [&] {
         return write_file_atomically(scratch.path / "sample.json", describe_scan(scan, window));
       }}};
  for (const auto& [what, write] : writers) {
    if (progress) progress(what);
    if (Result<void> r = write(); !r) return named_after(r.error(), scratch.path, folder);
    if (is_set(stop)) return interrupted();
  }
  for (const fs::path& made : {scratch.path / "png", scratch.path / "dicom", scratch.path})
    if (Result<void> r = sync_folder(made); !r) return r;

  for (const char* name : {"png", "dicom", "sample.nii.gz", "sample.json"})
    if (Result<void> r = move_or_exchange(scratch.path / name, folder / name); !r) return r;
  return sync_folder(folder);
}

}  // namespace trocar::sample
