// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/batch_run.h"

#include <algorithm>
#include <csignal>
#include <deque>
#include <unordered_map>

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/batch/lease.h"

namespace trocar::farm {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kLeaseCheckInterval{200};

struct Todo {
  std::size_t scan = 0;   // index in the batch
  bool is_stale = false;  // false: it is only verified
  bool is_done = false;   // by the index, which may not know of a damage or a change
};

struct Waiting {
  Todo todo;
  std::string key;
};

json journal_line(const std::string& scan, const Outcome& outcome) {
  json out = {{"scan", scan},
              {"key", outcome.key.empty() ? json() : json(outcome.key)},
              {"outcome", outcome_name(outcome.kind)},
              {"seconds", outcome.seconds},
              {"bytes", outcome.bytes},
              {"input_bytes", outcome.input_bytes},
              {"memory_bytes", outcome.memory_bytes},
              {"exit_code", outcome.exit_code}};
  if (outcome.signal != 0) out["signal"] = outcome.signal;
  if (!outcome.reason.empty()) out["reason"] = outcome.reason;
  if (!outcome.warnings.empty()) out["warnings"] = outcome.warnings;
  return out;
}

Outcome known_failure(const ScanState& state) {
  Outcome out;
  out.kind = Outcome::Kind::kKnownFailure;
  out.reason = state.why.at(0).at("reason").get<std::string>();
  out.exit_code = state.why.at(0).at("exit_code").get<int>();
  return out;
}

// One run: its queue, its processes and its summary.
class Run {
 public:
  Run(const std::vector<WantedScan>& wanted, const BatchSettings& settings,
      const ScanProgram& program, const Store& store)
      : wanted_(wanted),
        settings_(settings),
        program_(program),
        store_(store),
        journal_(store.folder() / "journal") {}

  Result<BatchSummary> operator()() {
    const auto start = Clock::now();
    if (auto ok = find_work(); !ok) return ok.error();
    total_ = todo_.size();
    while (processes_.running() > 0 || (has_work() && !has_enough_failures())) {
      if (is_stopped()) break;
      if (auto ok = start_more(); !ok) return ok.error();
      if (auto ended = processes_.wait(patience()); ended) finish(*ended);
      check_waiting();
    }
    end_all();
    // A killed process could not remove its temporary files.
    if (has_killed_) store_.remove_strays();
    summary_.scans = wanted_.size();
    summary_.left += todo_.size() + waiting_.size();
    std::sort(summary_.made_again.begin(), summary_.made_again.end());
    std::sort(summary_.warned.begin(), summary_.warned.end(),
              [](const WarnedScan& a, const WarnedScan& b) { return a.scan < b.scan; });
    std::sort(failed_.begin(), failed_.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    for (auto& [scan, outcome] : failed_) {
      auto& list = outcome.kind == Outcome::Kind::kFailed ? summary_.failed : summary_.known;
      list.push_back({wanted_[scan].scan->name, std::move(outcome)});
    }
    summary_.seconds = std::chrono::duration<double>(Clock::now() - start).count();
    return std::move(summary_);
  }

 private:
  bool is_stopped() const { return settings_.stop != nullptr && settings_.stop->load(); }

  bool has_work() const { return !todo_.empty() || !waiting_.empty(); }

  bool has_enough_failures() const {
    return settings_.max_failures > 0 && new_failures_ >= settings_.max_failures;
  }

  Result<void> find_work() {
    using Kind = ScanState::Kind;
    for (std::size_t k = 0; k < wanted_.size(); ++k) {
      const auto found = state_of(wanted_[k], program_, store_, {false, false, settings_.retry});
      if (!found) return found.error();
      const ScanState& state = *found;
      // Because of --rehash, unchanged scans get a process too, so that digests are computed
      // by several processes at the same time.
      const bool is_read =
          settings_.rehash || (settings_.verify && state.kind != Kind::kKnownFailure);
      if (state.kind == Kind::kStale || is_read) {
        todo_.push_back({k, state.kind == Kind::kStale, state.kind == Kind::kDone});
      } else if (state.kind == Kind::kDone) {
        ++summary_.unchanged;
        summary_.asset_bytes += state.asset_bytes;
        add_warnings(k, state.warnings);
      } else {
        failed_.emplace_back(k, known_failure(state));
      }
    }
    return {};
  }

  void add_warnings(std::size_t scan, const json& warnings) {
    if (!warnings.empty()) summary_.warned.push_back({wanted_[scan].scan->name, warnings});
  }

  Work work_of(const Todo& todo, int threads) const {
    return {wanted_[todo.scan], settings_.rehash, settings_.verify,
            settings_.retry,    threads,          settings_.stop};
  }

  Result<void> start_more() {
    const auto jobs = static_cast<std::size_t>(settings_.jobs);
    while (!todo_.empty() && processes_.running() < jobs && !has_enough_failures()) {
      // The last scans share the cores that finished scans have freed.
      const std::size_t at_once = std::min(jobs, todo_.size() + processes_.running());
      const Todo todo = todo_.front();
      const Work work = work_of(todo, static_cast<int>(std::max<std::size_t>(1, jobs / at_once)));
      auto ok = processes_.start(started_.size(),
                                 [&] { return json_text(json(work_on(work, store_, program_))); });
      if (!ok) return ok;
      todo_.pop_front();
      started_.push_back(todo);
    }
    return {};
  }

  std::chrono::milliseconds patience() const {
    return waiting_.empty() ? std::chrono::milliseconds(1000) : kLeaseCheckInterval;
  }

  void finish(const Ended& ended) {
    const Todo todo = started_[ended.task];
    const json sent = parse_json(ended.text);
    Outcome outcome;
    if (ended.signal == 0 && sent.is_object()) {
      sent.get_to(outcome);
    } else {
      has_killed_ = true;
      if (is_stopped()) return void(++summary_.left);
      outcome = record_killed(work_of(todo, 1), store_, program_, ended.signal, ended.exit_code);
    }
    outcome.seconds = ended.seconds;
    outcome.memory_bytes = ended.memory_bytes;
    if (outcome.kind == Outcome::Kind::kLeased) {
      waiting_.push_back({todo, outcome.key});
      return;
    }
    count(todo, std::move(outcome));
  }

  void count(const Todo& todo, Outcome outcome) {
    const std::string& name = wanted_[todo.scan].scan->name;
    const bool is_same = !todo.is_stale && outcome.kind == Outcome::Kind::kFound;
    if (todo.is_done && outcome.kind == Outcome::Kind::kMade) summary_.made_again.push_back(name);
    if (!is_same) summary_.has_journal &= journal_.add(journal_line(name, outcome));
    summary_.asset_bytes += outcome.bytes;
    add_warnings(todo.scan, outcome.warnings);
    switch (outcome.kind) {
      case Outcome::Kind::kMade:
        ++summary_.made;
        break;
      case Outcome::Kind::kFound:
        ++(is_same ? summary_.unchanged : summary_.found);
        break;
      case Outcome::Kind::kLeased:
      case Outcome::Kind::kInterrupted:
        ++summary_.left;
        break;
      case Outcome::Kind::kFailed:
        ++new_failures_;
        [[fallthrough]];
      case Outcome::Kind::kKnownFailure:
        summary_.has_unrecorded |= !outcome.is_recorded;
        failed_.emplace_back(todo.scan, std::move(outcome));
        break;
    }
    ++done_;
    if (settings_.progress) settings_.progress(done_, new_failures_, total_);
  }

  // If a key no longer has a valid lease, its outputs are finished or its process is dead. In both
  // cases the scan is started again.
  void check_waiting() {
    if (waiting_.empty() || Clock::now() < next_check_) return;
    next_check_ = Clock::now() + kLeaseCheckInterval;
    std::erase_if(waiting_, [this](const Waiting& one) {
      if (is_leased(store_, one.key)) return false;
      todo_.push_back(one.todo);
      return true;
    });
  }

  // The running scans end soon after SIGTERM, whose handler sets their stop flag.
  void end_all() {
    if (processes_.running() == 0) return;
    processes_.signal_all(SIGTERM);
    while (processes_.running() > 0) {
      const auto ended = processes_.wait(std::chrono::milliseconds(10'000));
      if (!ended) {
        processes_.signal_all(SIGKILL);
        continue;
      }
      const json sent = parse_json(ended->text);
      const Todo todo = started_[ended->task];
      Outcome outcome;
      if (ended->signal == 0 && sent.is_object()) sent.get_to(outcome);
      if (outcome.kind != Outcome::Kind::kFailed) {
        outcome.seconds = ended->seconds;
        count(todo, std::move(outcome));
      } else {
        has_killed_ |= ended->signal != 0;
        ++summary_.left;
      }
    }
  }

  const std::vector<WantedScan>& wanted_;
  const BatchSettings& settings_;
  const ScanProgram& program_;
  const Store& store_;
  Journal journal_;
  Processes processes_;
  std::deque<Todo> todo_;
  std::vector<Todo> started_;  // indexed by the processes' task numbers
  std::vector<Waiting> waiting_;
  std::vector<std::pair<std::size_t, Outcome>> failed_;  // also the known failures
  std::size_t new_failures_ = 0;
  BatchSummary summary_;
  std::size_t total_ = 0, done_ = 0;
  bool has_killed_ = false;
  Clock::time_point next_check_;
};

}  // namespace

Result<Batch> Batch::plan(const Collection& collection, const ScanProgram& program,
                          BatchSettings settings) {
  Batch out(program);
  out.settings_ = std::move(settings);
  std::set<std::string> unknown = out.settings_.only.value_or(std::set<std::string>());
  std::unordered_map<std::string, const Parameters*> known;
  for (std::size_t k = 0; k < collection.scans.size(); ++k) {
    const CollectionScan& scan = collection.scans[k];
    // The parameters of all scans are checked, so that every shard refuses a wrong collection.
    const auto [at, is_new] = known.emplace(json_text(scan.parameters), nullptr);
    if (is_new) {
      auto read = program.parameters(scan.parameters);
      if (!read && read.error().code == ExitCode::kUsage)
        return usage("scan " + scan.name + ": " + read.error().message);
      if (read) {
        out.parameters_.push_back(std::make_unique<Parameters>(std::move(*read)));
        at->second = out.parameters_.back().get();
      }
    }
    if (out.settings_.only) {
      unknown.erase(scan.name);
      if (!out.settings_.only->contains(scan.name)) continue;
    }
    if (const auto& shard = out.settings_.shard;
        shard &&
        k % static_cast<std::size_t>(shard->second) != static_cast<std::size_t>(shard->first))
      continue;
    out.wanted_.push_back({&scan, at->second});
  }
  if (!unknown.empty())
    return usage("--only: " + *unknown.begin() + ": the collection has no such scan");
  return out;
}

Result<std::vector<NamedState>> Batch::dry_run() const {
  const auto store = Store::open_for_reading(settings_.store);
  if (!store) return store.error();
  std::vector<NamedState> out;
  for (const WantedScan& one : wanted_) {
    auto state = state_of(one, *program_, *store, {settings_.rehash, false, settings_.retry});
    if (!state) return state.error();
    out.push_back({one.scan->name, std::move(*state)});
  }
  return out;
}

Result<ScanState> Batch::explain(const std::string& scan) const {
  const auto store = Store::open_for_reading(settings_.store);
  if (!store) return store.error();
  std::vector<std::string> names;
  for (const WantedScan& one : wanted_) {
    if (one.scan->name == scan)
      return state_of(one, *program_, *store, {settings_.rehash, true, settings_.retry});
    names.push_back(one.scan->name);
  }
  return usage("--explain " + scan + ": the collection has no such scan" +
               did_you_mean(scan, names));
}

Result<BatchSummary> Batch::run() const {
  const auto store = Store::open_for_writing(settings_.store);
  if (!store) {
    // A store that cannot be written suffices if no scan is stale.
    const auto states = dry_run();
    if (store.error().code != ExitCode::kUnwritable || settings_.rehash || settings_.verify ||
        !states)
      return store.error();
    BatchSummary out;
    out.scans = wanted_.size();
    for (const auto& [scan, state] : *states) {
      if (state.kind == ScanState::Kind::kStale) return store.error();
      out.asset_bytes += state.asset_bytes;
      if (!state.warnings.empty()) out.warned.push_back({scan, state.warnings});
      if (state.kind == ScanState::Kind::kKnownFailure)
        out.known.push_back({scan, known_failure(state)});
      else
        ++out.unchanged;
    }
    return out;
  }
  return Run(wanted_, settings_, *program_, *store)();
}

}  // namespace trocar::farm
