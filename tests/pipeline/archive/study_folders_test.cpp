// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/study_folders.h"

#include <gtest/gtest.h>

#include <chrono>

#include "tests/pipeline/archive/archive_files.h"
#include "tests/support/temporary_folder.h"

namespace trocar::archive {
namespace {

namespace fs = std::filesystem;

struct StudyFoldersTest : ::testing::Test {
  test::TemporaryFolder base;
  fs::path folder = base.path() / "scans";

  StudyFolders opened() {
    auto out = StudyFolders::open(folder);
    EXPECT_TRUE(out);
    return std::move(*out);
  }
  // An association with these files of a study.
  static fs::path association(StudyFolders& folders, const std::string& study,
                              const std::vector<std::pair<std::string, std::string>>& files) {
    const auto out = folders.new_association();
    EXPECT_TRUE(out);
    for (const auto& [name, text] : files)
      write_text(*out / study / name, text);
    return *out;
  }
  std::set<std::string> visible() const {
    std::set<std::string> out;
    for (const auto& entry : fs::directory_iterator(folder))
      if (entry.path().filename() != ".incoming") out.insert(entry.path().filename().string());
    return out;
  }
  std::size_t left_in(const char* part) const {
    const fs::directory_iterator at(folder / ".incoming" / part);
    return static_cast<std::size_t>(std::distance(fs::begin(at), fs::end(at)));
  }
  void make_older(const std::string& study, int hours) const {
    const fs::path mark = folder / ".incoming/received" / study;
    fs::last_write_time(mark, fs::last_write_time(mark) - std::chrono::hours(hours));
  }
};

TEST_F(StudyFoldersTest, FoldersAreOfThisUserAlone) {
  const StudyFolders folders = opened();
  EXPECT_EQ(fs::status(folder).permissions(), fs::perms::owner_all);
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    EXPECT_EQ(fs::status(entry).permissions() & (fs::perms::group_all | fs::perms::others_all),
              fs::perms::none)
        << entry.path();
}

TEST_F(StudyFoldersTest, StudyAppearsOnlyWhenItIsPublished) {
  StudyFolders folders = opened();
  const fs::path first = association(folders, kStudy, {{"1.dcm", "a"}, {"2.dcm", "b"}});
  EXPECT_EQ(visible(), std::set<std::string>());
  const auto taken = folders.take(first, {});
  ASSERT_TRUE(taken);
  ASSERT_EQ(taken->size(), 1U);
  EXPECT_EQ((*taken)[0].added, 2U);
  EXPECT_EQ(folders.growing(), std::set<std::string>{kStudy});
  EXPECT_EQ(folders.size_of(kStudy).instances, 2U);
  EXPECT_EQ(visible(), std::set<std::string>());
  const auto done = folders.publish(folders.growing_folder(kStudy), kStudy);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(done->instances, 2U);
  EXPECT_EQ(done->bytes, 2U);
  EXPECT_EQ(visible(), std::set<std::string>{kStudy});
  EXPECT_EQ(left_in("associations") + left_in("studies") + left_in("replaced"), 0U);
}

TEST_F(StudyFoldersTest, ExtendingKeepsWhatIsStored) {
  StudyFolders folders = opened();
  ASSERT_TRUE(folders.take(association(folders, kStudy, {{"1.dcm", "a"}}), {}));
  ASSERT_TRUE(folders.publish(folders.growing_folder(kStudy), kStudy));
  write_text(folder / kStudy / "notes.txt", "mine");
  ASSERT_TRUE(
      folders.take(association(folders, kStudy, {{"1.dcm", "changed"}, {"2.dcm", "b"}}), {}));
  const auto done = folders.publish(folders.growing_folder(kStudy), kStudy);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(done->added, 1U);
  EXPECT_EQ(done->different, 1U);
  EXPECT_EQ(read_text(folder / kStudy / "1.dcm"), "a");
  EXPECT_EQ(read_text(folder / kStudy / "2.dcm"), "b");
  EXPECT_EQ(read_text(folder / kStudy / "notes.txt"), "mine");
  EXPECT_EQ(left_in("studies") + left_in("replaced"), 0U);
}

TEST_F(StudyFoldersTest, SameInstancesChangeNothing) {
  StudyFolders folders = opened();
  for (const std::size_t added : {1U, 0U}) {
    ASSERT_TRUE(folders.take(association(folders, kStudy, {{"1.dcm", "a"}}), {}));
    const auto done = folders.publish(folders.growing_folder(kStudy), kStudy);
    ASSERT_TRUE(done);
    EXPECT_EQ(done->added, added);
    EXPECT_EQ(done->different, 0U);
  }
  EXPECT_EQ(left_in("studies"), 0U);
}

TEST_F(StudyFoldersTest, FileOfTheStudysNameIsNotReplaced) {
  StudyFolders folders = opened();
  write_text(folder / kStudy, "a file");
  ASSERT_TRUE(folders.take(association(folders, kStudy, {{"1.dcm", "a"}}), {}));
  const auto done = folders.publish(folders.growing_folder(kStudy), kStudy);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ExitCode::kUnwritable);
  EXPECT_EQ(read_text(folder / kStudy), "a file");
  EXPECT_EQ(folders.growing(), std::set<std::string>{kStudy});
}

TEST_F(StudyFoldersTest, ParallelAssociationsTogetherKeepTheLimit) {
  StudyFolders folders = opened();
  ArchiveLimits limits;
  limits.study_instances = 3;
  const fs::path a = association(folders, kStudy, {{"1.dcm", "a"}, {"2.dcm", "b"}});
  const fs::path b = association(folders, kStudy, {{"3.dcm", "c"}, {"4.dcm", "d"}});
  ASSERT_TRUE(folders.take(a, limits));
  const auto taken = folders.take(b, limits);
  ASSERT_TRUE(taken);
  EXPECT_EQ((*taken)[0].added, 1U);
  EXPECT_EQ((*taken)[0].excess, 1U);
  EXPECT_EQ(folders.size_of(kStudy).instances, 3U);
}

TEST_F(StudyFoldersTest, InstancesThatArePublishedDoNotCountTwice) {
  StudyFolders folders = opened();
  ArchiveLimits limits;
  limits.study_instances = 3;
  ASSERT_TRUE(folders.take(association(folders, kStudy, {{"1.dcm", "a"}, {"2.dcm", "b"}}), limits));
  EXPECT_TRUE(folders.has_instance(kStudy, "1.dcm", 1));
  ASSERT_TRUE(folders.publish(folders.growing_folder(kStudy), kStudy));
  EXPECT_TRUE(folders.has_instance(kStudy, "1.dcm", 1));
  EXPECT_FALSE(folders.has_instance(kStudy, "1.dcm", 2));
  EXPECT_FALSE(folders.has_instance(kStudy, "3.dcm", 1));
  const auto taken = folders.take(
      association(folders, kStudy, {{"1.dcm", "a"}, {"2.dcm", "b"}, {"3.dcm", "c"}}), limits);
  ASSERT_TRUE(taken);
  EXPECT_EQ((*taken)[0].excess, 0U);
  EXPECT_EQ(folders.size_of(kStudy).instances, 3U);
  EXPECT_EQ(folders.size_of(kStudy).bytes, 3U);
  // Another instance of the same name may be larger, so it counts.
  ASSERT_TRUE(folders.publish(folders.growing_folder(kStudy), kStudy));
  const auto larger = folders.take(association(folders, kStudy, {{"1.dcm", "larger"}}), limits);
  ASSERT_TRUE(larger);
  EXPECT_EQ((*larger)[0].excess, 1U);
}

TEST_F(StudyFoldersTest, TellsWhichStudiesAnAssociationSends) {
  StudyFolders folders = opened();
  const fs::path sent = association(folders, kStudy, {{"1.dcm", "a"}});
  write_text(sent / "arriving.part", "half");
  EXPECT_EQ(StudyFolders::studies_in(sent), std::set<std::string>{kStudy});
  EXPECT_EQ(StudyFolders::studies_in(folder / "none"), std::set<std::string>());
}

TEST_F(StudyFoldersTest, LeftoversOfDeadProcessesAreRemoved) {
  { const StudyFolders folders = opened(); }
  const fs::path incoming = folder / ".incoming";
  write_text(incoming / "associations/nobody/2.25.7/1.dcm", "half");
  write_text(incoming / "released/nobody/2.25.7/2.dcm", "whole");
  write_text(incoming / "replaced/new-2.25.8/1.dcm", "half");
  write_text(incoming / "replaced/2.25.9/1.dcm", "whole");  // killed between two renames
  write_text(incoming / "studies/2.25.10/1.dcm", "whole");  // its association had ended properly
  StudyFolders running = opened();
  const fs::path own = association(running, kStudy, {{"1.dcm", "a"}});
  const StudyFolders folders = opened();
  EXPECT_EQ(left_in("associations"), 1U);
  EXPECT_TRUE(fs::exists(own / kStudy / "1.dcm"));  // its process is alive
  EXPECT_EQ(left_in("replaced"), 0U);
  EXPECT_EQ(visible(), std::set<std::string>{"2.25.9"});
  EXPECT_EQ(folders.growing(), std::set<std::string>{"2.25.10"});
  ASSERT_EQ(folders.released().size(), 1U);
  ASSERT_TRUE(folders.take(folders.released()[0], {}));
  EXPECT_EQ(folders.growing(), (std::set<std::string>{"2.25.10", "2.25.7"}));
}

TEST_F(StudyFoldersTest, ReleasedAssociationIsKeptUntilItIsTaken) {
  StudyFolders folders = opened();
  const fs::path association_folder =
      association(folders, kStudy, {{"1.dcm", "a"}, {"2.dcm", "b"}});
  ASSERT_TRUE(folders.release(association_folder));
  EXPECT_FALSE(fs::exists(association_folder));
  ASSERT_EQ(folders.released().size(), 1U);
  write_text(folder / ".incoming/studies" / kStudy, "in the way");  // like a full disk
  EXPECT_FALSE(folders.take(folders.released()[0], {}));
  fs::remove(folder / ".incoming/studies" / kStudy);
  ASSERT_TRUE(folders.take(folders.released()[0], {}));
  EXPECT_EQ(folders.size_of(kStudy).instances, 2U);
  EXPECT_TRUE(folders.released().empty());
}

TEST_F(StudyFoldersTest, OneReceiverReservesTheFolder) {
  {
    StudyFolders first = opened();
    ASSERT_TRUE(first.reserve());
    StudyFolders second = opened();
    EXPECT_FALSE(second.reserve());
  }
  EXPECT_TRUE(opened().reserve());
}

TEST_F(StudyFoldersTest, RemovesWhatIsOldReceivedAndNotBusy) {
  StudyFolders folders = opened();
  for (const char* study : {"2.25.1", "2.25.2", "2.25.3"}) {
    ASSERT_TRUE(folders.take(association(folders, study, {{"1.dcm", "a"}}), {}));
    ASSERT_TRUE(folders.publish(folders.growing_folder(study), study));
  }
  write_text(folder / "2.25.4/1.dcm", "not received");
  make_older("2.25.1", 3);
  make_older("2.25.2", 3);
  EXPECT_EQ(folders.remove_older(2, {"2.25.2"}), std::vector<std::string>{"2.25.1"});
  EXPECT_EQ(visible(), (std::set<std::string>{"2.25.2", "2.25.3", "2.25.4"}));
  EXPECT_EQ(folders.remove_older(2, {}), std::vector<std::string>{"2.25.2"});
}

TEST_F(StudyFoldersTest, LinksOfOthersAreNotFollowed) {
  fs::create_directories(folder);
  fs::create_directory(base.path() / "elsewhere");
  fs::create_directory_symlink(base.path() / "elsewhere", folder / ".incoming");
  EXPECT_FALSE(StudyFolders::open(folder));
}

}  // namespace
}  // namespace trocar::archive
