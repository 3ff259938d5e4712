// SPDX-License-Identifier: GPL-3.0-or-later
// The store: store.md says where what is. Every file in it is written whole (whole_file.h).
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/farm/scan_files.h"

namespace trocar::farm {

/// Files of another host's process, by their age: temporary files, claims.
inline constexpr std::chrono::seconds kStrayAge{600}, kLease{60};

struct Object {
  std::string sha256;
  std::uint64_t bytes = 0;
  bool operator==(const Object&) const = default;
};
struct Outputs {
  Object asset, report;
  bool operator==(const Outputs&) const = default;
};

/// The index's entry of a scan.
struct ScanEntry {
  std::string name;
  std::string key;  ///< empty: it was not known
  std::string program;
  nlohmann::json parameters;
  std::string series = {};
  std::vector<ScanFile> files = {};
  std::optional<Outputs> outputs = {};  ///< of a scan that is done
  // Of a scan that failed:
  std::string reason = {};
  int exit_code = 0;
  int signal = 0;  ///< that killed its process
  bool is_done() const { return outputs.has_value(); }
};
nlohmann::json entry_json(const ScanEntry& entry);
/// Nothing if it is not what entry_json() gives.
std::optional<ScanEntry> entry_from(std::string_view text);

class Store {
 public:
  /// Makes the store, or completes one, and removes what killed processes left in it. Errors:
  /// (usage) a folder of other things, another version; (unwritable).
  static Result<Store> open_for_writing(const std::filesystem::path& folder);
  /// The store need not exist: it is empty then.
  static Result<Store> open_for_reading(const std::filesystem::path& folder);

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path tmp() const { return folder_ / "tmp"; }
  std::filesystem::path action_file(const std::string& key) const;
  std::filesystem::path content_file(const std::string& sha256) const;
  std::filesystem::path entry_file(const std::string& name) const;
  std::filesystem::path claim_file(const std::string& key) const;

  /// The outputs of an action, if it and they are there, with the sizes that they should have.
  std::optional<Outputs> find(const std::string& key) const;
  bool has(const Outputs& outputs) const;
  /// Makes the files as young as if they had just been written, so that --gc keeps them. False: one
  /// is not there any more.
  bool renew(const std::string& key, const Outputs& outputs) const;

  /// Writes an output, if there is none of its digest and size. Errors: unwritable, those of prove.
  Result<Object> put_content(
      std::span<const std::uint8_t> bytes,
      const std::function<Result<void>(std::span<const std::uint8_t>)>& prove) const;
  Result<void> put_action(const std::string& key, const nlohmann::json& action,
                          const Outputs& outputs) const;

  /// Nothing if there is none, or it is damaged.
  std::optional<ScanEntry> entry(const std::string& name) const;
  /// Whether the links for people lead to the entry's outputs, or are absent if it has none.
  bool links_fit(const ScanEntry& entry) const;
  /// Writes the entry and then its links.
  Result<void> put_entry(const ScanEntry& entry) const;
  /// Removes entry and links.
  void drop_entry(const std::string& name) const;
  /// All names in the index.
  std::vector<std::string> names() const;

  /// The time by the clock of the store's file system. Errors: unwritable.
  Result<std::chrono::nanoseconds> now() const;
  /// Removes temporary files and claims of processes that do not live any more. Gives their number.
  std::size_t remove_strays() const;

 private:
  explicit Store(std::filesystem::path folder) : folder_(std::move(folder)) {}
  std::filesystem::path folder_;
};

/// When a file was last changed, since 1970; nothing if it is not there.
std::optional<std::chrono::nanoseconds> time_of(const std::filesystem::path& file);

}  // namespace trocar::farm
