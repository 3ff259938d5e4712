// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/scan_files.h"

#include <glob.h>
#include <sodium.h>
#include <sys/stat.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <thread>
#include <unordered_map>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/open/scan_folder.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/nrrd.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// The bytes as lower-case hexadecimal digits.
std::string hex_of(std::span<const std::uint8_t> bytes) {
  std::string out(2 * bytes.size() + 1, '\0');
  sodium_bin2hex(out.data(), out.size(), bytes.data(), bytes.size());
  out.pop_back();
  return out;
}

Result<struct stat> status_of(const fs::path& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return refused_by_system(path.string(), errno);
  return status;
}

ScanFile file_of(const NamedFile& file, const struct stat& status) {
  return {file.of,
          file.path.string(),
          static_cast<std::uint64_t>(status.st_size),
          std::int64_t{status.st_mtim.tv_sec} * 1'000'000'000 + status.st_mtim.tv_nsec,
          static_cast<std::uint64_t>(status.st_ino),
          "",
          std::int64_t{status.st_ctim.tv_sec} * 1'000'000'000 + status.st_ctim.tv_nsec};
}

bool is_only_one_of_its_role(const NamedFile& file, const std::vector<NamedFile>& paths) {
  return std::count_if(paths.begin(), paths.end(),
                       [&file](const NamedFile& other) { return other.of == file.of; }) == 1;
}

Result<void> append_folder(const NamedFile& folder, std::vector<ScanFile>& files) {
  pipeline::SearchLimits limits;
  limits.must_reach_all = true;
  std::vector<pipeline::Warning> ignored;
  const auto below = pipeline::files_below(folder.path, ignored, limits);
  if (!below) return below.error();
  for (const fs::path& path : *below) {
    struct stat status {};
    // A link that leads nowhere has a state of its own: the scan is made again when it leads to a
    // file.
    if (::stat(path.c_str(), &status) != 0 && ::lstat(path.c_str(), &status) != 0)
      return refused_for_now(path.string() + ": " + system_message(errno));
    files.push_back(file_of({folder.of, path}, status));
  }
  return {};
}

// Returns std::nullopt if `hex` is damaged.
std::optional<std::string> from_hex(const std::string& hex) {
  std::string out(hex.size() / 2, '\0');
  std::size_t size = 0;
  const int done = sodium_hex2bin(reinterpret_cast<unsigned char*>(out.data()), out.size(),
                                  hex.data(), hex.size(), nullptr, &size, nullptr);
  if (done != 0 || size != out.size()) return std::nullopt;
  return out;
}

}  // namespace

std::span<const std::uint8_t> text_bytes(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::string sha256_of(std::span<const std::uint8_t> bytes) {
  unsigned char hash[crypto_hash_sha256_BYTES];
  crypto_hash_sha256(hash, bytes.data(), bytes.size());
  return hex_of(hash);
}

std::string sha256_of(std::string_view text) {
  return sha256_of(text_bytes(text));
}

Result<std::string> sha256_of_file(const std::filesystem::path& file) {
  const auto source = open_file(file);
  if (!source) return source.error();
  crypto_hash_sha256_state state;
  crypto_hash_sha256_init(&state);
  std::vector<std::uint8_t> block(1 << 18);
  for (std::uint64_t at = 0; at < (*source)->size(); at += block.size()) {
    const auto n = std::min<std::uint64_t>(block.size(), (*source)->size() - at);
    const std::span chunk(block.data(), static_cast<std::size_t>(n));
    if (auto ok = (*source)->read(at, chunk); !ok) return ok.error().after(file.string() + ": ");
    crypto_hash_sha256_update(&state, chunk.data(), chunk.size());
  }
  unsigned char hash[crypto_hash_sha256_BYTES];
  crypto_hash_sha256_final(&state, hash);
  return hex_of(hash);
}

bool is_sha256(std::string_view text) {
  return text.size() == 2 * crypto_hash_sha256_BYTES &&
         text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

bool same_state(const ScanFile& a, const ScanFile& b) {
  return a.of == b.of && a.path == b.path && a.size == b.size && a.mtime_ns == b.mtime_ns &&
         a.inode == b.inode && a.ctime_ns == b.ctime_ns;
}

bool same_state(const std::vector<ScanFile>& a, const std::vector<ScanFile>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const ScanFile& x, const ScanFile& y) { return same_state(x, y); });
}

Result<std::vector<fs::path>> inputs_of(const CollectionScan& scan) {
  std::vector<fs::path> out(scan.paths.begin(), scan.paths.end());
  if (scan.glob.empty()) return out;
  glob_t found{};
  // The batch has no threads, and a scan's process calls this before it starts any.
  const int failed =
      ::glob(scan.glob.c_str(), 0, nullptr, &found);  // NOLINT(concurrency-mt-unsafe)
  if (failed == 0) out.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  ::globfree(&found);
  if (failed == GLOB_NOMATCH) return refused(scan.glob + ": no file matches");
  if (failed != 0) return refused_for_now(scan.glob + ": the pattern's folders cannot be read");
  std::sort(out.begin(), out.end(), pipeline::natural_less);
  return out;
}

std::vector<NamedFile> all_paths(const std::vector<fs::path>& inputs,
                                 const Parameters& parameters) {
  std::vector<NamedFile> out;
  out.reserve(inputs.size() + parameters.files.size());
  for (const fs::path& path : inputs)
    out.push_back({"input", path});
  out.insert(out.end(), parameters.files.begin(), parameters.files.end());
  return out;
}

Result<std::vector<ScanFile>> list_files(const std::vector<NamedFile>& paths) {
  std::vector<ScanFile> out;
  for (const NamedFile& one : paths) {
    const auto status = status_of(one.path);
    if (!status) return status.error();
    if (S_ISREG(status->st_mode)) {
      const auto folder = pipeline::folder_of_dicomdir(one.path);
      if (!folder || !is_only_one_of_its_role(one, paths)) {
        out.push_back(file_of(one, *status));
        for (const fs::path& path : pipeline::files_of_volume(one.path)) {
          if (path == one.path) continue;
          const auto of_data = status_of(path);
          if (!of_data) return of_data.error();
          out.push_back(file_of({one.of, path}, *of_data));
        }
      } else if (auto ok = append_folder({one.of, *folder}, out); !ok) {
        return ok.error();
      }
    } else if (S_ISDIR(status->st_mode)) {
      if (auto ok = append_folder(one, out); !ok) return ok.error();
    } else {
      return refused(one.path.string() + ": neither a file nor a folder");
    }
  }
  return out;
}

void let_times_settle(const std::vector<ScanFile>& files) {
  using namespace std::chrono;
  constexpr std::int64_t kSecond = 1'000'000'000;
  // The kernel's clock for the times of files advances in steps of up to 10 ms. Some file systems
  // store whole seconds, or multiples of two seconds.
  constexpr std::int64_t kStep = 20'000'000;
  const std::int64_t now =
      duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
  std::int64_t wait = 0;
  for (const ScanFile& file : files) {
    for (const std::int64_t time : {file.mtime_ns, file.ctime_ns}) {
      const std::int64_t step = time % kSecond == 0 ? 2 * kSecond : kStep;
      const std::int64_t left = time + step - now;
      // A time far in the future was set by hand.
      if (left <= 2 * kSecond) wait = std::max(wait, left);
    }
  }
  if (wait > 0) std::this_thread::sleep_for(nanoseconds(wait));
}

Result<void> digest_files(const std::vector<NamedFile>& wanted, std::vector<ScanFile>& files) {
  std::unordered_map<std::string, std::size_t> by_path;
  for (std::size_t k = 0; k < files.size(); ++k)
    by_path.emplace(files[k].of + ":" + files[k].path, k);
  for (const NamedFile& one : wanted) {
    const auto [at, is_new] = by_path.emplace(one.of + ":" + one.path.string(), files.size());
    if (is_new) {
      const auto status = status_of(one.path);
      if (!status) return status.error();
      files.push_back(file_of(one, *status));
    }
    ScanFile& file = files[at->second];
    if (!file.sha256.empty()) continue;
    if (const auto ok = sha256_of_file(one.path).into(file.sha256); !ok) return ok.error();
  }
  return {};
}

json files_json(const std::vector<ScanFile>& files) {
  json out = json::array();
  for (const ScanFile& file : files) {
    out.push_back({{"of", file.of},
                   {"path", file.path},
                   {"size", file.size},
                   {"mtime_ns", file.mtime_ns},
                   {"inode", file.inode},
                   {"ctime_ns", file.ctime_ns},
                   {"sha256", file.sha256.empty() ? json() : json(file.sha256)}});
    if (!is_utf8(file.path)) out.back()["path_hex"] = hex_of(text_bytes(file.path));
  }
  return out;
}

std::optional<std::vector<ScanFile>> files_from(const json& files) {
  try {
    std::vector<ScanFile> out;
    out.reserve(files.size());
    for (const json& one : files) {
      const json& digest = one.at("sha256");
      const auto hex = one.find("path_hex");
      const auto path =
          hex == one.end() ? one.at("path").get<std::string>() : from_hex(hex->get<std::string>());
      if (!path) return std::nullopt;
      out.push_back({one.at("of").get<std::string>(), *path, one.at("size").get<std::uint64_t>(),
                     one.at("mtime_ns").get<std::int64_t>(), one.at("inode").get<std::uint64_t>(),
                     digest.is_null() ? std::string() : digest.get<std::string>(),
                     one.value("ctime_ns", std::int64_t{-1})});
    }
    return out;
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

json action_of(const std::string& program, const json& parameters,
               const std::vector<NamedFile>& wanted, const std::vector<ScanFile>& files) {
  std::unordered_map<std::string, const ScanFile*> by_path;
  for (const ScanFile& file : files)
    by_path.emplace(file.of + ":" + file.path, &file);
  json out = {{"schema", "trocar.action/1"}, {"program", program}, {"parameters", parameters}};
  for (const NamedFile& one : wanted)
    out[one.of].push_back(by_path.at(one.of + ":" + one.path.string())->sha256);
  return out;
}

std::string key_of(const json& action) {
  return sha256_of(json_text(action));
}

}  // namespace trocar::farm
