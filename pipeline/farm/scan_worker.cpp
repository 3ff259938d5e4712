// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/scan_worker.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <new>
#include <optional>
#include <system_error>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/base/file_io.h"
#include "pipeline/farm/action_key.h"
#include "pipeline/farm/failpoint.h"
#include "pipeline/farm/lease.h"
#include "pipeline/farm/sha256.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::array<const char*, 5> kOutcomes = {"made", "found", "failed", "leased",
                                                  "interrupted"};

std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
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

// Takes over the digests from the index if no file has changed.
void reuse_digests(const std::vector<ScanFile>& known, std::vector<ScanFile>& files) {
  if (!same_state(known, files)) return;
  for (std::size_t k = 0; k < files.size(); ++k)
    files[k].sha256 = known[k].sha256;
}

std::uint64_t bytes_read(const std::vector<ScanFile>& files) {
  std::uint64_t out = 0;
  for (const ScanFile& file : files)
    out += file.sha256.empty() ? 0 : file.size;
  return out;
}

// Removes a content file if its bytes do not have the digest in its name, or if it should be an
// asset and is not a valid one.
void remove_damaged(const Store& store, const Object& object, bool is_asset) {
  const fs::path file = store.content_file(object.sha256);
  const auto bytes = read_file(file);
  const bool is_whole = bytes && sha256_of(*bytes) == object.sha256 &&
                        (!is_asset || prove_asset(*bytes, file.string()));
  if (!is_whole) ::unlink(file.c_str());
}

// The steps of the work on one scan.
class Worker {
 public:
  Worker(const Work& work, const Store& store, const ScanProgram& program)
      : work_(work), scan_(*work.wanted.scan), store_(store), program_(program) {
    entry_.name = scan_.name;
    entry_.program = *work.wanted.program;
    entry_.series = scan_.series;
    entry_.parameters = json::object();
  }

  // An error is recorded as the scan's failure.
  Result<Outcome::Kind> run() {
    known_ = store_.entry(scan_.name);
    if (work_.wanted.parameters == nullptr) {
      const auto again = program_.parameters(scan_.parameters);
      return again ? bug("parameters that were refused are accepted now") : again.error();
    }
    entry_.parameters = work_.wanted.parameters->canonical;
    const auto inputs = inputs_of(scan_);
    if (!inputs) return inputs.error();
    const std::vector<NamedFile> paths = all_paths(*inputs, *work_.wanted.parameters);
    auto listed = list_files(paths);
    if (!listed) return listed.error();
    entry_.files = std::move(*listed);
    let_times_settle(entry_.files);
    if (known_ && !work_.rehash) reuse_digests(known_->files, entry_.files);
    std::vector<NamedFile> wanted = paths;
    if (program_.opens_first(*inputs, *work_.wanted.parameters)) {
      if (auto ok = open(*inputs); !ok) return ok.error();
      wanted = opened_->files();
    }
    if (auto ok = digest_files(wanted, entry_.files); !ok) return ok.error();
    failpoint("digested");
    if (auto ok = check_unchanged(paths); !ok) return ok.error();
    action_ = action_of(entry_.program, entry_.parameters, wanted, entry_.files);
    entry_.key = key_of(action_);
    return find_or_make(*inputs, paths);
  }

  ScanEntry& entry() { return entry_; }
  const json& warnings() const { return warnings_; }

 private:
  Result<void> open(const std::vector<fs::path>& inputs) {
    auto opened = program_.open(scan_.parameters, inputs, scan_.series, work_.threads);
    if (!opened) return opened.error();
    opened_ = std::move(*opened);
    return {};
  }

  // Refuses a scan whose files changed after they were listed: its digests and its mesh would be
  // those of different states.
  Result<void> check_unchanged(const std::vector<NamedFile>& paths) const {
    const auto now = list_files(paths);
    if (!now) return refused(now.error().message + "; it existed when the work on this scan began");
    if (same_state(*now, entry_.files)) return {};
    std::string changed = "a file was added or removed";
    for (std::size_t k = 0; k < std::min(now->size(), entry_.files.size()); ++k) {
      if (same_state((*now)[k], entry_.files[k])) continue;
      changed = entry_.files[k].path;
      break;
    }
    return refused(changed + ": changed while the scan was read; run again when it is complete");
  }

  Result<Outcome::Kind> find_or_make(const std::vector<fs::path>& inputs,
                                     const std::vector<NamedFile>& paths) {
    // A concurrent --gc can remove found outputs before the index refers to them.
    for (int attempt = 0; attempt < 3; ++attempt) {
      auto found = store_.find(entry_.key);
      if (found && work_.verify) {
        remove_damaged(store_, found->asset, true);
        remove_damaged(store_, found->report, false);
        found = store_.find(entry_.key);
      }
      Outcome::Kind kind = Outcome::Kind::kFound;
      if (!found || !store_.renew(entry_.key, *found)) {
        const auto lease = Lease::take(store_, entry_.key, scan_.name);
        if (!lease) return lease.error();
        if (*lease == nullptr) return Outcome::Kind::kLeased;
        // The previous holder of the lease may have finished.
        found = store_.find(entry_.key);
        if (!found || !store_.renew(entry_.key, *found)) {
          auto made = make(inputs, paths);
          if (!made) return made.error();
          found = *made;
          kind = Outcome::Kind::kMade;
        }
        failpoint("action-done");
        if (auto ok = put_entry(*found); !ok) return ok.error();
      } else if (auto ok = put_entry(*found); !ok) {
        return ok.error();
      }
      if (store_.has(*found)) return kind;
    }
    return unwritable(store_.folder().string() +
                      ": another process removes its files while they are written");
  }

  Result<void> put_entry(const Outputs& outputs) {
    entry_.outputs = outputs;
    // An entry with the same contents stays untouched.
    if (known_ && store_.links_fit(entry_) && entry_json(*known_) == entry_json(entry_)) return {};
    return store_.put_entry(entry_);
  }

  Result<Outputs> make(const std::vector<fs::path>& inputs, const std::vector<NamedFile>& paths) {
    if (!opened_) {
      if (auto ok = open(inputs); !ok) {
        // A file that is still being written is often refused. Then the reported reason is that the
        // file changed.
        if (auto same = check_unchanged(paths); !same) return same.error();
        return ok.error();
      }
    }
    failpoint("opened");
    auto product = opened_->mesh();
    failpoint("meshed");
    if (auto ok = check_unchanged(paths); !ok) return ok.error();
    if (!product) return product.error();
    opened_.reset();
    warnings_ = std::move(product->warnings);
    Outputs out;
    const auto no_proof = [](std::span<const std::uint8_t>) { return Result<void>(); };
    auto report = store_.put_content(bytes_of(product->report), no_proof);
    if (!report) return report.error();
    out.report = *report;
    auto asset = store_.put_content(product->asset, [this](std::span<const std::uint8_t> glb) {
      return prove_asset(glb, scan_.name);
    });
    if (!asset) return asset.error();
    out.asset = *asset;
    if (auto ok = store_.put_action(entry_.key, action_, out); !ok) return ok.error();
    return out;
  }

  const Work& work_;
  const CollectionScan& scan_;
  const Store& store_;
  const ScanProgram& program_;
  ScanEntry entry_;
  std::optional<ScanEntry> known_;  // the entry in the index before this run
  json action_, warnings_ = json::array();
  std::unique_ptr<OpenedScan> opened_;
};

}  // namespace

const char* outcome_name(Outcome::Kind kind) {
  return kOutcomes.at(static_cast<std::size_t>(kind));
}

json outcome_json(const Outcome& o) {
  return {
      {"kind", static_cast<int>(o.kind)}, {"key", o.key},          {"reason", o.reason},
      {"exit_code", o.exit_code},         {"bytes", o.bytes},      {"input_bytes", o.input_bytes},
      {"is_recorded", o.is_recorded},     {"warnings", o.warnings}};
}

Outcome outcome_from(const json& value) {
  Outcome out;
  out.kind = static_cast<Outcome::Kind>(value.at("kind").get<int>());
  out.key = value.at("key").get<std::string>();
  out.reason = value.at("reason").get<std::string>();
  out.exit_code = value.at("exit_code").get<int>();
  out.bytes = value.at("bytes").get<std::uint64_t>();
  out.input_bytes = value.at("input_bytes").get<std::uint64_t>();
  out.is_recorded = value.at("is_recorded").get<bool>();
  out.warnings = value.at("warnings");
  return out;
}

Result<void> prove_asset(std::span<const std::uint8_t> glb, const std::string& name) {
  const auto asset = decode_asset(glb, name);
  if (!asset) return asset.error();
  return verify_asset(*asset, name);
}

Outcome work_on(const Work& work, const Store& store, const ScanProgram& program) {
  Worker worker(work, store, program);
  Result<Outcome::Kind> done = Outcome::Kind::kFailed;
  try {
    done = worker.run();
  } catch (const std::bad_alloc&) {
    done = refused("not enough memory for this input");
  } catch (const std::exception& failure) {
    done = bug(std::string("internal error: ") + failure.what());
  }
  ScanEntry& entry = worker.entry();
  Outcome out;
  out.key = entry.key;
  out.input_bytes = bytes_read(entry.files);
  out.warnings = worker.warnings();
  if (done) {
    out.kind = *done;
    if (entry.outputs) out.bytes = entry.outputs->asset.bytes;
    return out;
  }
  if (work.stop != nullptr && work.stop->load()) {
    out.kind = Outcome::Kind::kInterrupted;
    return out;
  }
  out.reason = entry.reason = done.error().message;
  out.exit_code = entry.exit_code = static_cast<int>(done.error().code);
  entry.outputs.reset();
  out.is_recorded = static_cast<bool>(store.put_entry(entry));
  return out;
}

Outcome record_killed(const Work& work, const Store& store, int signal, int exit_code) {
  ScanEntry entry;
  entry.name = work.wanted.scan->name;
  entry.program = *work.wanted.program;
  entry.series = work.wanted.scan->series;
  entry.parameters =
      work.wanted.parameters == nullptr ? json::object() : work.wanted.parameters->canonical;
  entry.signal = signal;
  entry.exit_code = signal != 0 ? 128 + signal : exit_code;
  const char* const name = signal == 0 ? nullptr : ::sigabbrev_np(signal);
  entry.reason = signal == 0 ? "its process ended without a result, with exit code " +
                                   std::to_string(exit_code)
                             : "its process was killed by signal " + std::to_string(signal) +
                                   (name == nullptr ? "" : " (SIG" + std::string(name) + ")");
  Outcome out;
  out.reason = entry.reason;
  out.exit_code = entry.exit_code;
  out.signal = signal;
  out.is_recorded = static_cast<bool>(store.put_entry(entry));
  return out;
}

}  // namespace trocar::farm
