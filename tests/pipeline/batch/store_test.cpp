// SPDX-License-Identifier: GPL-3.0-or-later
// The store's files: digests, keys, atomic files, leases, garbage.
#include "pipeline/batch/store.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <string>

#include "pipeline/batch/garbage.h"
#include "pipeline/batch/lease.h"
#include "tests/pipeline/batch/store_fixture.h"
#include "tests/support/file_size_limit.h"
#include "tests/support/take.h"
#include "tests/support/temporary_folder.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using namespace std::chrono_literals;

Store opened(const test::TemporaryFolder& folder) {
  auto store = Store::open_for_writing(folder / "store");
  if (!store) throw std::runtime_error(store.error().message);
  return *store;
}

std::size_t files_in(const fs::path& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

mode_t mode_of(const fs::path& file) {
  struct stat status {};
  ::stat(file.c_str(), &status);
  return status.st_mode & 07777;
}

void make_old(const fs::path& file, std::chrono::seconds age) {
  const auto now = std::chrono::duration_cast<std::chrono::seconds>(
      std::chrono::system_clock::now().time_since_epoch());
  const timespec time{(now - age).count(), 0};
  const timespec times[2] = {time, time};
  ::utimensat(AT_FDCWD, file.c_str(), times, 0);
}

TEST(Sha256, IsTheStandards) {  // FIPS 180-2, appendix B
  EXPECT_EQ(sha256_of(std::string_view("abc")),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  const test::TemporaryFolder folder;
  std::ofstream(folder / "million") << std::string(1'000'000, 'a');
  EXPECT_EQ(*sha256_of_file(folder / "million"),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  EXPECT_FALSE(sha256_of_file(folder / "none"));
  EXPECT_TRUE(is_sha256(sha256_of(std::string_view(""))));
  EXPECT_FALSE(is_sha256("../../etc/passwd"));
}

TEST(Key, DependsOnBytesAndTheirOrderAndNotOnNames) {
  const auto key = [](const std::vector<ScanFile>& files, const json& parameters) {
    std::vector<NamedFile> wanted;
    wanted.reserve(files.size());
    for (const ScanFile& file : files)
      wanted.push_back({file.of, file.path});
    return key_of(action_of("program", parameters, wanted, files));
  };
  const std::vector<ScanFile> two = {{"input", "a", 1, 2, 3, "aa"}, {"input", "b", 1, 2, 4, "bb"}};
  const std::string plain = key(two, {{"t", 1}});
  EXPECT_TRUE(is_sha256(plain));
  EXPECT_EQ(key({{"input", "x", 9, 9, 9, "aa"}, {"input", "y", 9, 9, 9, "bb"}}, {{"t", 1}}), plain);
  EXPECT_NE(key({two[1], two[0]}, {{"t", 1}}), plain);
  EXPECT_NE(key({two[0]}, {{"t", 1}}), plain);
  EXPECT_NE(key(two, {{"t", 2}}), plain);
  EXPECT_NE(key({two[0], {"hu", "b", 1, 2, 4, "bb"}}, {{"t", 1}}), plain);
  EXPECT_NE(key_of(action_of("other", {{"t", 1}}, {}, {})),
            key_of(action_of("program", {{"t", 1}}, {}, {})));
}

TEST(ProcessIdentity, KnowsALivingADeadAndAForeignProcess) {
  const ProcessIdentity me = this_process();
  EXPECT_EQ(life_of(me), Life::kAlive);
  EXPECT_EQ(*identity_in(me.text() + ".17"), me);
  ProcessIdentity other = me;
  other.start += 1;  // the number was used again
  EXPECT_EQ(life_of(other), Life::kDead);
  other = me;
  other.host = std::string("node.with.dots");
  EXPECT_EQ(identity_in(other.text() + ".17")->host, "node.with.dots");
  EXPECT_EQ(life_of(other), Life::kUnknown);
  for (const char* wrong : {"", ".", "a.b.c", "a.b.x.1.2", "....", "a.b.1.2"})
    EXPECT_FALSE(identity_in(wrong)) << wrong;
  const pid_t child = ::fork();
  if (child == 0) ::_exit(this_process().pid == ::getpid() ? 0 : 1);
  siginfo_t ended{};
  ASSERT_EQ(::waitid(P_PID, static_cast<id_t>(child), &ended, WEXITED | WNOWAIT), 0);
  EXPECT_EQ(ended.si_status, 0);
  other = me;
  other.pid = child;
  EXPECT_EQ(life_of(other), Life::kDead);  // though it was not yet collected
  ::waitpid(child, nullptr, 0);
}

TEST(AtomicFile, LeavesTheTargetOrTheNewBytesAndNothingElse) {
  const test::TemporaryFolder folder;
  fs::create_directory(folder / "tmp");
  const fs::path target = folder / "file";
  ASSERT_TRUE(write_atomically({target, folder / "tmp", 0600}, "old"));
  EXPECT_EQ(mode_of(target), 0600u);
  const auto unproven = write_atomically(
      {target, folder / "tmp", 0666, true, [](auto) { return refused("no"); }}, "new");
  EXPECT_FALSE(unproven);
  EXPECT_EQ(text_in(target), "old");
  {
    const test::FileSizeLimit limit(1000);
    const auto full = write_atomically({target, folder / "tmp"}, std::string(5000, 'x'));
    ASSERT_FALSE(full);
    EXPECT_EQ(full.error().code, ExitCode::kUnwritable);
    EXPECT_EQ(full.error().message, target.string() + ": cannot be written: File too large");
  }
  EXPECT_EQ(text_in(target), "old");
  EXPECT_EQ(files_in(folder / "tmp"), 0u);
  ASSERT_TRUE(write_atomically({target, folder / "tmp"}, "new"));
  EXPECT_EQ(text_in(target), "new");
}

TEST(Store, FindsWhatIsWholeAndOnlyThat) {
  const test::TemporaryFolder folder;
  const Store store = opened(folder);
  const auto [key, outputs] = put(store, "one");
  EXPECT_EQ(store.find(key), outputs);
  EXPECT_FALSE(store.find(std::string(64, '0')));
  EXPECT_EQ(mode_of(store.action_file(key)), 0600u);
  const fs::path asset = store.content_file(outputs.asset.sha256);
  fs::resize_file(asset, 3);
  EXPECT_FALSE(store.find(key));
  EXPECT_EQ(*store.put_content(text_bytes("asset one"), {}), outputs.asset);
  EXPECT_EQ(store.find(key), outputs);
  std::ofstream(store.action_file(key)) << "{}";
  EXPECT_FALSE(store.find(key));
  // An action under the key of another one.
  const auto [other, other_outputs] = put(store, "two");
  fs::copy_file(store.action_file(other), store.action_file(key),
                fs::copy_options::overwrite_existing);
  EXPECT_FALSE(store.find(key));
}

TEST(Store, EntriesComeBackAndDamagedOnesDoNot) {
  const test::TemporaryFolder folder;
  const Store store = opened(folder);
  const auto [key, outputs] = put(store, "one");
  ScanEntry entry = done_entry("a", {key, outputs});
  entry.files = {{"input", "x.nii", 5, 1795302334403408632, 7, sha256_of(std::string_view("x"))},
                 {"input", "y.nii", 5, -1, 8}};
  ASSERT_TRUE(store.put_entry(entry));
  EXPECT_EQ(entry_json(*store.entry("a")), entry_json(entry));
  EXPECT_TRUE(store.links_fit(entry));
  EXPECT_EQ(text_in(folder / "store/assets/a.glb"), "asset one");
  EXPECT_EQ(mode_of(store.entry_file("a")), 0600u);
  entry.reason = std::string("why");
  entry.exit_code = 137;
  entry.signal = 9;
  ASSERT_TRUE(store.put_entry(entry));
  EXPECT_FALSE(store.entry("a")->is_done());
  EXPECT_EQ(store.entry("a")->outputs, outputs);  // those of an earlier run
  EXPECT_EQ(entry_json(*store.entry("a")), entry_json(entry));
  EXPECT_TRUE(store.links_fit(entry));
  EXPECT_EQ(text_in(folder / "store/assets/a.glb"), "asset one");
  entry.outputs.reset();
  ASSERT_TRUE(store.put_entry(entry));
  EXPECT_EQ(entry_json(*store.entry("a")), entry_json(entry));
  EXPECT_FALSE(fs::is_symlink(folder / "store/assets/a.glb"));
  const std::string text = text_in(store.entry_file("a"));
  for (std::size_t cut = 0; cut + 2 < text.size(); ++cut)
    EXPECT_FALSE(entry_from(text.substr(0, cut))) << cut;
}

TEST(Store, RemovesWhatDeadProcessesLeftAndNothingElse) {
  const test::TemporaryFolder folder;
  const Store store = opened(folder);
  ProcessIdentity dead = this_process();
  dead.start += 1;
  ProcessIdentity foreign = this_process();
  foreign.host = std::string("elsewhere");
  const auto plant = [&](const fs::path& file, const ProcessIdentity& process,
                         std::chrono::seconds age) {
    std::ofstream(file) << process.text() << ".0\nscan\n";
    make_old(file, age);
    return file;
  };
  const fs::path tmp = store.tmp(), leases = folder / "store" / "claims";
  plant(tmp / (dead.text() + ".1"), dead, 0s);
  plant(tmp / (foreign.text() + ".1"), foreign, kStrayAge + 5s);
  plant(leases / "1", dead, 0s);
  plant(leases / "2", foreign, kLeaseDuration + 5s);
  plant(tmp / "of nobody", foreign, kStrayAge + 5s);
  // The file server's clock was set back after this one was made.
  plant(tmp / (foreign.text() + ".3"), foreign, -kStrayAge - 60s);
  const fs::path kept[] = {
      plant(tmp / (this_process().text() + ".1"), this_process(), kStrayAge + 5s),
      plant(tmp / (foreign.text() + ".2"), foreign, kStrayAge - 60s),
      plant(leases / "3", this_process(), kLeaseDuration + 5s),
      plant(leases / "4", foreign, kLeaseDuration - 20s)};
  EXPECT_EQ(store.remove_strays(), 6u);
  for (const fs::path& file : kept)
    EXPECT_TRUE(fs::exists(file)) << file;
}

TEST(Lease, OneProcessAtATime) {
  const test::TemporaryFolder folder;
  const Store store = opened(folder);
  const std::string key(64, 'a');
  {
    const auto mine = Lease::take(store, key, "scan");
    ASSERT_TRUE(mine && *mine != nullptr);
    EXPECT_TRUE(is_leased(store, key));
    const auto second = test::take(Lease::take(store, key, "scan"));
    EXPECT_EQ(second, nullptr);
    EXPECT_EQ(mode_of(store.lease_file(key)), 0600u);
  }
  EXPECT_FALSE(is_leased(store, key));
  EXPECT_EQ(files_in(store.tmp()), 0u);
}

TEST(Lease, OfADeadProcessOrAnExpiredOneIsTakenOver) {
  const test::TemporaryFolder folder;
  const Store store = opened(folder);
  const std::string key(64, 'a');
  ProcessIdentity dead = this_process(), foreign = this_process();
  dead.start += 1;
  foreign.host = std::string("elsewhere");
  for (const auto& [process, age, is_void] :
       {std::tuple{dead, 0s, true}, std::tuple{foreign, kLeaseDuration + 5s, true},
        std::tuple{foreign, kLeaseDuration - 20s, false},
        std::tuple{foreign, 20s - kLeaseDuration, false},
        std::tuple{foreign, -kLeaseDuration - 20s, true}}) {
    std::ofstream(store.lease_file(key)) << process.text() << ".0\nscan\n";
    make_old(store.lease_file(key), age);
    EXPECT_EQ(is_leased(store, key), !is_void);
    const auto taken = test::take(Lease::take(store, key, "scan"));
    EXPECT_EQ(taken != nullptr, is_void) << process.host << age.count();
    fs::remove(store.lease_file(key));
  }
}

TEST(Garbage, KeepsWhatTheIndexLeadsToWhatIsYoungAndWhatIsClaimed) {
  const test::TemporaryFolder folder;
  const Store store = opened(folder);
  const auto [live, live_outputs] = put(store, "live");
  const auto [young, young_outputs] = put(store, "young");
  const auto [leased, leased_outputs] = put(store, "leased");
  const auto [old, old_outputs] = put(store, "old");
  ASSERT_TRUE(store.put_entry(done_entry("a", {live, live_outputs})));
  for (const auto& [key, outputs] :
       {std::pair{live, live_outputs}, std::pair{leased, leased_outputs},
        std::pair{old, old_outputs}})
    for (const fs::path& file : {store.action_file(key), store.content_file(outputs.asset.sha256),
                                 store.content_file(outputs.report.sha256)})
      make_old(file, 7200s);
  const auto held = Lease::take(store, leased, "scan");
  const auto done = test::take(collect_garbage(store, 1h));
  EXPECT_EQ(done.removed, 3u);
  EXPECT_EQ(done.kept, 9u);
  EXPECT_TRUE(store.find(live) && store.find(young) && store.find(leased));
  EXPECT_FALSE(store.find(old));
  EXPECT_FALSE(fs::exists(store.content_file(old_outputs.asset.sha256)));
  // Who finds an old action renews it, and it stays.
  for (const fs::path& file :
       {store.action_file(young), store.content_file(young_outputs.asset.sha256),
        store.content_file(young_outputs.report.sha256)})
    make_old(file, 7200s);
  EXPECT_TRUE(store.renew(young, young_outputs));
  EXPECT_EQ(collect_garbage(store, 1h)->removed, 0u);
}

TEST(Store, OfAnotherVersionOrAFolderOfOtherThingsIsRefused) {
  const test::TemporaryFolder folder;
  fs::create_directory(folder / "home");
  std::ofstream(folder / "home/letter.txt") << "x";
  EXPECT_EQ(Store::open_for_writing(folder / "home").error().code, ExitCode::kUsage);
  EXPECT_EQ(Store::open_for_reading(folder / "home").error().code, ExitCode::kUsage);
  opened(folder);
  std::ofstream(folder / "store/trocar-store.json") << R"({"schema": "trocar.store/2"})";
  EXPECT_EQ(Store::open_for_writing(folder / "store").error().code, ExitCode::kUsage);
  EXPECT_TRUE(Store::open_for_reading(folder / "nowhere"));
  EXPECT_EQ(Store::open_for_writing(folder / "no/where").error().code, ExitCode::kUnwritable);
}

}  // namespace
}  // namespace trocar::farm
