// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/files.h"

#include <sodium.h>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <system_error>
#include <vector>

#include "embedded/runtime/report/history_page.js.h"
#include "embedded/runtime/report/session_page.js.h"
#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/payload.h"
#include "formats/base/files.h"
#include "formats/base/html_page.h"
#include "formats/base/json.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/console/access.h"
#include "runtime/console/answers.h"
#include "runtime/console/session_files.h"
#include "runtime/session/origin.h"

namespace trocar::runtime {
namespace {

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{8} << 20;
constexpr std::size_t kMaxFiles = 64;
constexpr const char* kVendor = "vendor";

/// Returns the file's content type; empty: the file does not belong to the page.
std::string type_of(const std::filesystem::path& file) {
  static const std::map<std::string, std::string> types = {
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".mjs", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".woff2", "font/woff2"},
      {".txt", "text/plain; charset=utf-8"},
      {".ico", "image/x-icon"}};
  const auto found = types.find(file.extension().string());
  return found == types.end() ? "" : found->second;
}

/// Returns the hashes of the scripts in session reports and in the history.
std::string report_hashes() {
  return script_hashes(html_page("", kSessionPage, {}), "<script>") +
         script_hashes(html_page("", kHistoryPage, {}), "<script>");
}

constexpr const char* kIncomplete =
    "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Trocar console</title>"
    "<body><p>The page's libraries (three.js and uPlot) are not here. Run "
    "<code>scripts/setup console</code> in the sources, or install the package "
    "<code>trocar-console</code>, and start the console again.</p></body></html>\n";

using nlohmann::json;

constexpr int kMaxDepth = 2;
constexpr const char* kSessions = "sessions";
constexpr std::size_t kMaxInspected = 20'000, kMaxShown = 2000;
constexpr std::size_t kMaxPrimitives = 1'000'000;  // that all nodes of an asset may show together
constexpr std::uint64_t kMaxSceneBytes = std::uint64_t{4} << 20;
constexpr std::size_t kHeadBytes = std::size_t{64} << 10, kTailBytes = std::size_t{16} << 10;

json failed(const std::string& name, const std::string& message) {
  return {{"file", name}, {"error", message}};
}

json describe(const Scene& scene, const std::string& name) {
  json slices = json::array();
  for (const SceneSlice& slice : scene.slices)
    slices.push_back(slice.index);
  json entry = {{"file", name},
                {"name", scene.name},
                {"asset", scene.asset.filename().string()},
                {"force_law", to_string(scene.force_law.kind)},
                {"duration_s", scene.duration_s},
                {"slices", slices}};
  if (scene.hand.live) entry["live_hand"] = true;
  if (scene.body) entry["body"] = {{"from", scene.body->from}, {"to", scene.body->to}};
  return entry;
}

std::optional<double> number_at(const json& list, std::size_t index) {
  if (!list.is_array() || index >= list.size() || !list[index].is_number()) return std::nullopt;
  return list[index].get<double>();
}

/// Returns the accessor of the positions of a primitive; null if the primitive does not
/// consist of triangles.
const json* positions_of(const json& primitive, const json& accessors) {
  static const json::json_pointer kPosition("/attributes/POSITION");
  if (!primitive.is_object() || primitive.value("mode", json(4)) != json(4) ||
      !primitive.contains(kPosition))
    return nullptr;
  const json& at = primitive[kPosition];
  if (!at.is_number_unsigned() || at.get<std::uint64_t>() >= accessors.size()) return nullptr;
  return &accessors[at.get<std::size_t>()];
}

/// Returns a reference, because a copy of a large member for each of many nodes would take hours.
const json& member(const json& object, const char* key) {
  static const json kNull;
  const auto found = object.is_object() ? object.find(key) : object.end();
  return object.is_object() && found != object.end() ? *found : kNull;
}

json describe_asset(const json& document, const std::string& name) {
  static const json::json_pointer kSurface("/extras/trocar/surface");
  json entry = {{"file", name}};
  const json& ours = member(member(document, "extras"), "trocar");
  const json& stated = member(ours, "slices");
  const json &nodes = member(document, "nodes"), &meshes = member(document, "meshes"),
             &accessors = member(document, "accessors");
  if (!stated.is_number_unsigned() || !nodes.is_array() || !meshes.is_array() ||
      !accessors.is_array())
    return failed(name, name + ": is not an asset of trocar-mesh");
  // The matrix of node 0 converts a slice's units to metres.
  const double unit_mm =
      nodes.empty() ? 0 : std::abs(number_at(member(nodes[0], "matrix"), 0).value_or(0)) * 1e3;
  constexpr double kUnset = std::numeric_limits<double>::infinity();
  Eigen::Array3d low = Eigen::Array3d::Constant(kUnset), high = -low;
  std::uint64_t surface_triangles = 0;
  std::size_t seen = 0;  // primitives of all nodes; several nodes may share a mesh
  for (const json& node : nodes) {
    const json& mesh = member(node, "mesh");
    if (!mesh.is_number_unsigned() || mesh.get<std::uint64_t>() >= meshes.size()) continue;
    const bool is_surface = node.contains(kSurface);
    const json& primitives = member(meshes[mesh.get<std::size_t>()], "primitives");
    if (!primitives.is_array()) continue;
    seen += primitives.size();
    if (seen > kMaxPrimitives)
      return failed(name, name + ": has more meshes than an asset may have");
    for (const json& primitive : primitives) {
      const json* const positions = positions_of(primitive, accessors);
      if (positions == nullptr) continue;
      if (is_surface) {
        const json& indices = member(primitive, "indices");
        if (indices.is_number_unsigned() && indices.get<std::uint64_t>() < accessors.size()) {
          const json& count = member(accessors[indices.get<std::size_t>()], "count");
          if (count.is_number_unsigned()) surface_triangles += count.get<std::uint64_t>() / 3;
        }
        continue;
      }
      const json &shift = member(node, "translation"), &matrix = member(node, "matrix");
      constexpr std::size_t kShiftOfMatrix = 12;
      for (const char* end : {"min", "max"}) {
        const json& bound = member(*positions, end);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const auto x = number_at(bound, axis);
          if (!x) continue;
          const double at = *x + number_at(shift, axis).value_or(0) +
                            number_at(matrix, kShiftOfMatrix + axis).value_or(0);
          const auto i = static_cast<Eigen::Index>(axis);
          low[i] = std::min(low[i], at);
          high[i] = std::max(high[i], at);
        }
      }
    }
  }
  entry["slices"] = stated;
  if (low.minCoeff() < kUnset && std::isfinite(unit_mm)) {
    const Eigen::Array3d sides_mm = (low <= high).select(high - low, 0) * unit_mm;
    entry["extent_mm"] = {sides_mm[0], sides_mm[1], sides_mm[2]};
  }
  entry["surface_triangles"] = surface_triangles;
  return entry;
}

/// Returns the extension of a file's name, ".csv" of a recording that is partial.
std::string extension_of(const std::filesystem::path& file) {
  const std::string name = file.filename().string();
  if (!is_partial_name(name)) return file.extension().string();
  return std::filesystem::path(name.substr(0, name.rfind(kPartialSuffix))).extension().string();
}

/// The time is the first field of a row.
std::optional<double> time_of(std::string_view line) {
  const std::string_view text = line.substr(0, line.find(','));
  double t_s = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), t_s);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(t_s))
    return std::nullopt;
  return t_s;
}

/// Describes a recording. Reads only the first and last rows, because listing a folder must
/// not read gigabytes.
json describe_recording(ByteSource& source, const std::string& name, bool is_partial,
                        std::string& scene_digest) {
  const auto fail = [&](const char* why) { return failed(name, name + why); };
  std::vector<std::uint8_t> head(std::min<std::uint64_t>(source.size(), kHeadBytes)),
      tail(std::min<std::uint64_t>(source.size(), kTailBytes));
  if (!source.read(0, head) || !source.read(source.size() - tail.size(), tail))
    return fail(": cannot be read");
  const std::string_view first(reinterpret_cast<const char*>(head.data()), head.size());
  std::string_view last(reinterpret_cast<const char*>(tail.data()), tail.size());
  std::vector<std::string_view> lines;
  for (std::size_t at = 0; lines.size() < 3;) {
    const std::size_t end = first.find('\n', at);
    if (end == std::string_view::npos) break;
    lines.push_back(first.substr(at, end - at));
    at = end + 1;
  }
  if (lines.size() < 2) return fail(": has no row");
  if (!is_partial && !last.ends_with('\n')) return fail(": its last line is cut");
  last = last.substr(0, last.rfind('\n'));
  const std::size_t before = last.rfind('\n');
  if (before == std::string_view::npos) return fail(": its last line is longer than 16 kB");
  const auto begin = time_of(lines[1]), end = time_of(last.substr(before + 1)),
             second = lines.size() > 2 ? time_of(lines[2]) : begin;
  if (!begin || !end || !second || *end < *begin || (lines.size() > 2 && *second <= *begin))
    return fail(": its times are not ascending numbers");
  const double period_s = lines.size() > 2 ? *second - *begin : 0;
  const double ticks = period_s > 0 ? std::round((*end - *begin) / period_s) + 1 : 1;
  if (!(ticks < 1e12)) return fail(": its times are not those of a session");
  json entry = {{"file", name},
                {"duration_s", *end - *begin + period_s},
                {"ticks", static_cast<std::uint64_t>(ticks)}};
  if (is_partial) entry["partial"] = true;
  const std::size_t text = lines[1].rfind(',');
  if (const auto origin = parse_origin(lines[1].substr(text + 1)); origin) {
    if (const std::string* const digest = origin->find(kOriginScene)) scene_digest = *digest;
  }
  return entry;
}

}  // namespace

std::string script_hashes(std::string_view html, std::string_view tag) {
  constexpr std::string_view kEnd = "</script>";
  std::string hashes;
  for (std::size_t at = html.find(tag); at != std::string_view::npos; at = html.find(tag, at)) {
    at += tag.size();
    const std::size_t end = html.find(kEnd, at);
    if (end == std::string_view::npos) break;
    std::array<unsigned char, crypto_hash_sha256_BYTES> hash{};
    ::crypto_hash_sha256(hash.data(), reinterpret_cast<const unsigned char*>(html.data() + at),
                         end - at);
    std::array<char,
               sodium_base64_ENCODED_LEN(crypto_hash_sha256_BYTES, sodium_base64_VARIANT_ORIGINAL)>
        text{};
    ::sodium_bin2base64(text.data(), text.size(), hash.data(), hash.size(),
                        sodium_base64_VARIANT_ORIGINAL);
    hashes += std::string(" 'sha256-") + text.data() + "'";
    at = end;
  }
  return hashes;
}

const std::string& report_policy() {
  static const std::string policy = "default-src 'none'; style-src 'unsafe-inline'; script-src" +
                                    report_hashes() +
                                    "; sandbox allow-scripts; frame-ancestors 'none'";
  return policy;
}

Result<PageFiles> PageFiles::read(const std::filesystem::path& folder) {
  PageFiles page;
  std::error_code error;
  bool has_vendor = false;
  for (const std::string part : {"", "hand", "imaging", "planning", "view", kVendor}) {
    for (std::filesystem::directory_iterator entry(folder / part, error), end;
         !error && entry != end; entry.increment(error)) {
      std::error_code ignored;
      const std::string type = type_of(entry->path());
      if (type.empty() || !entry->is_regular_file(ignored)) continue;
      if (page.files_.size() == kMaxFiles)
        return refused(folder.string() + ": has more than 64 files for the page");
      Result<std::vector<std::uint8_t>> bytes = read_file(entry->path(), kMaxFileBytes);
      if (!bytes) return bytes.error();
      has_vendor = has_vendor || part == kVendor;
      const std::string name =
          (std::filesystem::path("/") / part / entry->path().filename()).string();
      page.files_[name] = {type, std::string(bytes->begin(), bytes->end())};
    }
  }
  const auto index = page.files_.find("/index.html");
  if (index == page.files_.end())
    return refused(folder.string() +
                   ": has no index.html; --page names the folder with the console's page");
  if (!has_vendor) index->second.bytes = kIncomplete;
  page.policy_ =
      "default-src 'none'; script-src 'self'" +
      script_hashes(index->second.bytes, "<script type=\"importmap\">") +
      report_hashes() +  // a report in a frame inherits this policy
      "; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self'; "
      "connect-src 'self'; frame-src blob:; worker-src 'self'; base-uri 'none'; form-action "
      "'none'; frame-ancestors 'none'";
  page.files_["/"] = index->second;
  return page;
}

const PageFile* PageFiles::find(std::string_view target) const {
  const auto found = files_.find(target);
  return found == files_.end() ? nullptr : &found->second;
}

std::filesystem::path page_folder() {
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  std::filesystem::path installed = program.parent_path().parent_path() / "share/trocar/console";
  if (!error && std::filesystem::exists(installed / "index.html", error)) return installed;
  return TROCAR_CONSOLE_PAGE;
}

Result<Files> Files::of_folder(const std::filesystem::path& folder,
                               const std::filesystem::path& sessions) {
  std::error_code error;
  Files files;
  files.folder_ = std::filesystem::canonical(folder, error);
  if (error || !std::filesystem::is_directory(files.folder_, error))
    return refused(folder.string() + ": is no folder");
  files.sessions_ = sessions.empty() ? files.folder_ / kSessions
                                     : std::filesystem::weakly_canonical(sessions, error);
  if (error) return unwritable(sessions.string() + ": " + error.message());
  return files;
}

Files Files::of_recording(const std::filesystem::path& recording,
                          const std::filesystem::path& against,
                          const std::filesystem::path& scene) {
  Files files;
  files.fixed_[recording.filename().string()] = recording;
  files.fixed_[scene.filename().string()] = scene;
  if (!against.empty()) {
    const std::string name = against.filename().string();
    files.fixed_[files.fixed_.contains(name) ? "against-" + name : name] = against;
  }
  return files;
}

std::filesystem::path Files::path_of(std::string_view name) const {
  constexpr std::string_view kBegin = "sessions/";
  if (name.starts_with(kBegin)) {
    std::error_code error;
    std::filesystem::path session = sessions_ / name.substr(kBegin.size());
    if (std::filesystem::exists(session, error)) return session;
  }
  return folder_ / name;
}

Result<std::filesystem::path> Files::find(std::string_view name) const {
  const std::string shown = json_text(std::string(name.substr(0, 80)));
  if (folder_.empty()) {
    const auto found = fixed_.find(name);
    if (found == fixed_.end()) return refused(shown + ": is not a file of this playback");
    return found->second;
  }
  if (!is_file_name(name)) return refused(shown + ": is not the name of a file in the folder");
  const std::filesystem::path file = path_of(name);
  std::error_code error;
  const std::filesystem::path there = std::filesystem::canonical(file, error);
  if (error) return refused(shown + ": there is no such file in the folder");
  if (there != file) return refused(shown + ": is a link");
  if (!std::filesystem::is_regular_file(there, error))
    return refused(shown + ": is not a regular file");
  return there;
}

Files::Known Files::read(const std::filesystem::path& file, const std::string& name) const {
  Known known;
  const bool is_partial = is_partial_name(name);
  const std::string end = extension_of(file);
  const auto shown = [&](const char* kind, const json& entry) {
    known.kind = kind;
    known.json = json_text(entry);
  };
  if (end == ".json") {
    const auto bytes = read_file(file, kMaxSceneBytes);
    if (!bytes) return known;
    const std::string_view text(reinterpret_cast<const char*>(bytes->data()), bytes->size());
    if (text.find(kSceneSchema) == std::string_view::npos) {
      // Perhaps a scene while somebody edits it. The files of sessions are other programs'.
      if (name.starts_with("sessions/")) return known;
      if (const auto read = parse_strict_json(text, name); !read)
        shown("scenes", failed(name, read.error().message));
      return known;
    }
    if (const auto digest = digest_of(file)) known.digest = *digest;
    const Result<Scene> scene = parse_scene(text, name, file.parent_path());
    shown("scenes", scene ? describe(*scene, name) : failed(name, scene.error().message));
    if (scene) known.asset = scene->asset;
  } else if (end == ".glb") {
    const Result<std::string> text = glb_json(file);
    if (!text) {
      shown("assets", failed(name, name + ": is not a readable asset"));
      return known;
    }
    const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(text->data()),
                                              text->size());
    const auto document = parse_json_text(bytes);
    shown("assets", document ? describe_asset(*document, name)
                             : failed(name, name + ": its JSON is damaged"));
  } else if (end == ".csv") {
    constexpr std::string_view kBegin = "t_s,x_m,";
    const auto source = open_file(file);
    std::array<char, kBegin.size()> begin{};
    const std::span<std::uint8_t> into(reinterpret_cast<std::uint8_t*>(begin.data()), begin.size());
    if (!source || !(*source)->read(0, into) ||
        std::string_view(begin.data(), begin.size()) != kBegin)
      return known;
    shown("recordings", describe_recording(**source, name, is_partial, known.digest));
    // The console's note beside a session's recording names the device.
    if (const std::size_t slash = name.rfind('/'); slash != std::string::npos) {
      if (const auto note = find(name.substr(0, slash + 1) + "console.json"))
        known.device = noted_device(*note);
    }
  }
  return known;
}

template <typename Inspect>
bool Files::search(const std::filesystem::path& root, const std::string& prefix, int depth,
                   Inspect inspect) const {
  std::error_code error;
  std::size_t inspected = 0;
  for (std::filesystem::recursive_directory_iterator
           entry(root, std::filesystem::directory_options::skip_permission_denied, error),
       end;
       !error && entry != end; entry.increment(error)) {
    if (++inspected > kMaxInspected) return false;
    std::error_code ignored;
    const bool is_link = entry->is_symlink(ignored);
    const bool is_hidden = entry->path().filename().string().starts_with('.');
    if (entry.depth() >= depth || is_link || is_hidden) entry.disable_recursion_pending();
    const std::string end_of_name = extension_of(entry->path());
    if (is_link || is_hidden || !entry->is_regular_file(ignored) ||
        (end_of_name != ".json" && end_of_name != ".glb" && end_of_name != ".csv"))
      continue;
    const std::string name = prefix + entry->path().lexically_relative(root).generic_string();
    if (!is_file_name(name) || path_of(name) != entry->path()) continue;
    inspect(entry->path(), name);
  }
  return true;
}

std::string Files::list() {
  std::map<std::string, Known> now;
  bool is_truncated = false;
  const auto inspect = [&](const std::filesystem::path& file, const std::string& name) {
    std::error_code error;
    const std::uint64_t size = std::filesystem::file_size(file, error);
    const auto time =
        error ? std::filesystem::file_time_type{} : std::filesystem::last_write_time(file, error);
    if (error) return;
    const auto before = known_.find(name);
    if (before != known_.end() && before->second.size == size && before->second.time == time) {
      now[name] = std::move(before->second);
      return;
    }
    // The list has a recording when its session has ended.
    if (is_partial_name(name) && is_being_recorded(file)) return;
    Known known = read(file, name);
    known.size = size;
    known.time = time;
    now[name] = std::move(known);
  };
  if (folder_.empty()) {
    for (const auto& [name, file] : fixed_)
      inspect(file, name);
  } else {
    const bool is_apart = sessions_ != folder_ / kSessions;
    is_truncated = !search(folder_, "", kMaxDepth, inspect);
    if (is_apart) is_truncated |= !search(sessions_, "sessions/", kMaxDepth - 1, inspect);
  }
  known_ = std::move(now);

  std::map<std::string, std::string> scene_by_digest;
  for (const auto& [name, known] : known_) {
    if (known.kind == "scenes") scene_by_digest.emplace(known.digest, name);
  }
  json out = {{"scenes", json::array()}, {"assets", json::array()}, {"recordings", json::array()}};
  for (const auto& [name, known] : known_) {
    if (known.kind.empty()) continue;
    if (out[known.kind].size() == kMaxShown) {
      is_truncated = true;
      continue;
    }
    json entry = parse_known_json(known.json);
    // The scene does not change when its asset comes or goes.
    std::error_code ignored;
    if (!known.asset.empty() && !std::filesystem::is_regular_file(known.asset, ignored))
      entry["asset_missing"] = true;
    if (known.kind == "recordings") {
      const auto scene = scene_by_digest.find(known.digest);
      if (scene != scene_by_digest.end()) entry["scene"] = scene->second;
      // The report of a session has the same name as its recording. A session that was killed has none.
      std::string report = std::filesystem::path(name).replace_extension(".html").string();
      if (!is_partial_name(name) && find(report)) entry["report"] = std::move(report);
      if (!known.device.empty()) entry["device"] = known.device;
    }
    out[known.kind].push_back(std::move(entry));
  }
  if (is_truncated) out["truncated"] = true;
  return json_text(out);
}

}  // namespace trocar::runtime
