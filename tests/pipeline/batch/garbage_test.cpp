// SPDX-License-Identifier: GPL-3.0-or-later
// Garbage collection of damaged stores.
#include "pipeline/batch/garbage.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <functional>
#include <map>
#include <random>

#include "tests/pipeline/batch/store_fixture.h"
#include "tests/support/campaign.h"
#include "tests/support/take.h"
#include "tests/support/temporary_folder.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using namespace std::chrono_literals;

constexpr uid_t kNobody = 65534;

ScanEntry entry_of(const std::string& name, const Made& made) {
  ScanEntry out = done_entry(name, made);
  out.files = {{"input", name + ".nii", 5, 17, 7, sha256_of(std::string_view(name))}};
  return out;
}

// Scans that are done, of which two share an asset, a scan that failed after it was done, one that
// was refused, and what no scan refers to.
void fill(const Store& store) {
  for (const char* name : {"a", "b", "c"})
    ASSERT_TRUE(store.put_entry(entry_of(name, put(store, name))));
  ASSERT_TRUE(store.put_entry(entry_of("twin", put(store, "a"))));
  ScanEntry failed = entry_of("failed", put(store, "failed"));
  failed.reason = std::string("out of reach");
  failed.exit_code = 3;
  ASSERT_TRUE(store.put_entry(failed));
  ScanEntry refused = entry_of("refused", {sha256_of(std::string_view("refused")), {}});
  refused.outputs.reset();
  refused.reason = std::string("no image");
  refused.exit_code = 3;
  refused.is_lasting = true;
  ASSERT_TRUE(store.put_entry(refused));
  put(store, "dead");
  put(store, "dead too");
  ASSERT_TRUE(store.put_content(text_bytes("of nobody"), {}));
  std::ofstream(store.folder() / "journal/host-1-2.ndjson") << "{\"scan\":\"a\"}\n";
}

std::vector<fs::path> paths_below(const fs::path& folder) {
  std::vector<fs::path> out;
  std::error_code ignored;
  for (auto one = fs::recursive_directory_iterator(folder, ignored);
       one != fs::recursive_directory_iterator(); one.increment(ignored))
    if (!one->is_directory()) out.push_back(one->path());
  std::sort(out.begin(), out.end());
  return out;
}

void age(const fs::path& store, std::chrono::seconds age = 7200s) {
  const auto then = fs::file_time_type::clock::now() - age;
  for (const char* part : {"actions", "content"})
    for (const fs::path& file : paths_below(store / part))
      fs::last_write_time(file, then);
}

class GarbageTest : public testing::Test {
 protected:
  void SetUp() override {
    fs::permissions(folder_.path(), fs::perms(0755));
    fs::create_directory(folder_ / "whole");
    fill(*Store::open_for_writing(folder_ / "whole"));
    age(folder_ / "whole");
  }
  // A copy of the store whose files are old.
  Store copy() const {
    fs::remove_all(folder_ / "store");
    fs::copy(folder_ / "whole", folder_ / "store",
             fs::copy_options::recursive | fs::copy_options::copy_symlinks);
    age(folder_ / "store");
    return *Store::open_for_writing(folder_ / "store");
  }
  // Expects that the collection is refused, names the file, and removes nothing.
  static void expect_refusal(const Store& store, const std::string& named) {
    const auto before = paths_below(store.folder());
    const auto done = collect_garbage(store, 0s);
    ASSERT_FALSE(done) << named;
    EXPECT_EQ(done.error().code, ExitCode::kRefused);
    EXPECT_NE(done.error().message.find(named), std::string::npos) << done.error().message;
    EXPECT_EQ(paths_below(store.folder()), before);
  }

  test::TemporaryFolder folder_;
};

TEST_F(GarbageTest, KeepsWhatEntriesNameThoughAllActionsAreGone) {
  const Store store = copy();
  for (const fs::path& action : paths_below(store.folder() / "actions"))
    fs::remove(action);
  const auto done = test::take(collect_garbage(store, 0s));
  EXPECT_EQ(done.removed, 5u);  // two dead assets and reports, and what belonged to nobody
  for (const char* name : {"a", "b", "c", "twin", "failed"})
    EXPECT_TRUE(store.has(*store.entry(name)->outputs)) << name;
}

// The message names the file. More damages: NoDamageCostsAnAssetThatAnEntryNames.
TEST_F(GarbageTest, WhatCannotBeReadStopsIt) {
  for (const char* text :
       {"", "7", R"({"action": {}, "outputs": 1})", R"({"schema": "trocar.scan/2"})"}) {
    Store store = copy();
    std::ofstream(store.entry_file("b")) << text;
    expect_refusal(store, store.entry_file("b").string());
    store = copy();
    const fs::path action = store.action_file(store.entry("c")->key);
    std::ofstream(action) << text;
    expect_refusal(store, action.string());
  }
  const Store store = copy();
  fs::remove_all(store.folder() / "actions");
  std::ofstream(store.folder() / "actions") << "no folder";
  expect_refusal(store, (store.folder() / "actions").string());
}

TEST_F(GarbageTest, DropsNoScanIfItRemovesNothing) {
  const Store store = copy();
  std::ofstream(store.entry_file("b")) << "{";
  const std::set<std::string> wanted = {"a", "b"};
  EXPECT_FALSE(collect_garbage(store, 0s, &wanted));
  EXPECT_TRUE(fs::exists(store.entry_file("c")));
  ASSERT_TRUE(store.put_entry(entry_of("b", put(store, "b"))));
  const auto done = test::take(collect_garbage(store, 0s, &wanted));
  EXPECT_EQ(done.dropped, 4u);
  EXPECT_EQ(*store.names(), (std::vector<std::string>{"a", "b"}));
}

TEST_F(GarbageTest, ATimeInTheFutureProtectsNoFileForEver) {
  const Store store = copy();
  age(store.folder(), -24h);
  EXPECT_EQ(collect_garbage(store, 48h)->removed, 0u);  // within the grace
  EXPECT_EQ(collect_garbage(store, 1h)->removed, 7u);
  EXPECT_TRUE(store.has(*store.entry("a")->outputs));
  // What another process renews meanwhile has a time just after that at which this one began.
  const Store next = copy();
  age(next.folder(), -5s);
  EXPECT_EQ(collect_garbage(next, 0s)->removed, 0u);
}

// What an entry names; empty if its file is damaged.
std::set<std::string> named_by(const std::optional<ScanEntry>& entry) {
  std::set<std::string> out;
  if (!entry) return out;
  if (entry->outputs) out = {entry->outputs->asset.sha256, entry->outputs->report.sha256};
  return out;
}

class Damage {
 public:
  explicit Damage(unsigned seed) : random_(seed) {}

  // Damages a file or folder of the store, and returns what was done.
  std::string operator()(const fs::path& store) {
    const char* const part = pick({"scans", "scans", "actions", "actions", "content", "journal"});
    const std::vector<fs::path> files = paths_below(store / part);
    if (files.empty()) return "nothing";
    const fs::path& file = files[below(files.size())];
    const std::string bytes = text_in(file);
    const std::string where = file.lexically_relative(store).string();
    std::error_code ignored;
    switch (below(9)) {
      case 0:
        fs::remove(file);
        return "removed " + where;
      case 1:
        fs::resize_file(file, below(bytes.size() + 1), ignored);
        return "tore " + where;
      case 2:
        std::ofstream(file) << pick({R"({"outputs": 1})", "[]", "null", "{\"schema\": 7}",
                                     R"({"schema": "trocar.scan/9"})", "\xff\xfe"});
        return "replaced " + where;
      case 3:
        if (bytes.empty()) return "nothing";
        {
          std::string changed = bytes;
          changed[below(bytes.size())] ^= static_cast<char>(1U << below(7));
          std::ofstream(file, std::ios::binary) << changed;
        }
        return "flipped a bit of " + where;
      case 4:
        ::chmod(file.c_str(), 0);
        return "locked " + where;
      case 5:
        ::chmod(file.parent_path().c_str(), pick({0U, 0311U, 0111U}));
        return "locked the folder of " + where;
      case 6:
        fs::last_write_time(file, fs::file_time_type::clock::now() + 24h * (1 + below(9999)),
                            ignored);
        return "dated " + where;
      case 7:
        fs::remove(file);
        if (below(2) == 0)
          fs::create_directory(file);
        else
          fs::create_symlink("nowhere", file);
        return "replaced by no file " + where;
      default:
        if (::geteuid() != 0) return "nothing";
        if (::chown(file.c_str(), 12345, 12345) != 0) return "nothing";
        ::chmod(file.c_str(), 0600);
        return "gave away " + where;
    }
  }

 private:
  std::size_t below(std::size_t n) {
    return std::uniform_int_distribution<std::size_t>(0, n - 1)(random_);
  }
  template <typename T>
  T pick(std::initializer_list<T> values) {
    return values.begin()[below(values.size())];
  }
  std::mt19937 random_;
};

// Runs the collection in a process without the rights of root, which reads everything. Returns 0 or
// the exit code of the error.
int collect_as_user(const fs::path& folder) {
  const pid_t child = ::fork();
  if (child == 0) {
    if (::geteuid() == 0 && (::setgid(kNobody) != 0 || ::setuid(kNobody) != 0)) ::_exit(99);
    const auto store = Store::open_for_writing(folder);
    if (!store) ::_exit(static_cast<int>(store.error().code));
    const auto done = collect_garbage(*store, 0s);
    ::_exit(done ? 0 : static_cast<int>(done.error().code));
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}

void unlock(const fs::path& folder) {
  std::error_code ignored;
  ::chmod(folder.c_str(), 0755);
  for (const auto& one : fs::directory_iterator(folder, ignored)) {
    if (one.is_symlink()) continue;
    if (one.is_directory())
      unlock(one.path());
    else
      ::chmod(one.path().c_str(), 0644);
  }
}

TEST_F(GarbageTest, NoDamageCostsAnAssetThatAnEntryNames) {
  const int rounds = test::campaign(40);
  Damage damage(70);
  std::mt19937 random(71);
  int collected = 0, stopped = 0;
  for (int round = 0; round < rounds; ++round) {
    const Store store = copy();
    const fs::path& root = store.folder();
    if (::geteuid() == 0) {
      ASSERT_EQ(::chown(root.c_str(), kNobody, kNobody), 0);
      for (const auto& one : fs::recursive_directory_iterator(root))
        ASSERT_EQ(::lchown(one.path().c_str(), kNobody, kNobody), 0);
    }
    std::map<std::string, std::set<std::string>> named;
    const auto names = store.names();
    for (const std::string& name : *names)
      named[name] = named_by(store.entry(name));
    std::string what;
    for (unsigned k = 0; k <= random() % 3; ++k)
      what += damage(root) + "; ";
    for (auto& [name, digests] : named) {
      const auto entry = store.read_entry(name);  // as root reads it
      if (entry && !*entry) digests.clear();
      if (entry && *entry) digests = named_by(**entry);
    }
    const auto before = paths_below(root / "content");
    const int code = collect_as_user(root);
    ++(code == 0 ? collected : stopped);
    EXPECT_TRUE(code == 0 || code == 3 || code == 4) << code << ": " << what;
    unlock(root);
    for (const auto& [name, digests] : named)
      for (const std::string& digest : digests) {
        const fs::path file = store.content_file(digest);
        const bool was_there = std::binary_search(before.begin(), before.end(), file);
        EXPECT_TRUE(!was_there || fs::exists(fs::symlink_status(file)))
            << name << ": " << what << code;
      }
    if (code != 0) {
      EXPECT_EQ(paths_below(root / "content"), before) << what;
    }
  }
  EXPECT_GT(collected, rounds / 8);
  EXPECT_GT(stopped, rounds / 8);
}

}  // namespace
}  // namespace trocar::farm
