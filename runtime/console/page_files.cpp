// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/page_files.h"

#include <sodium.h>

#include <array>
#include <system_error>
#include <utility>
#include <vector>

#include "embedded/runtime/reporting/history_page.js.h"
#include "embedded/runtime/reporting/session_page.js.h"
#include "formats/base/file_io.h"
#include "formats/base/html_page.h"

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

}  // namespace trocar::runtime
