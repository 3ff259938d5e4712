// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/instance_file.h"

#include <gtest/gtest.h>

#include "tests/pipeline/archive/archive_files.h"
#include "tests/support/temporary_folder.h"

namespace trocar::archive {
namespace {

namespace fs = std::filesystem;

struct StoreTest : ::testing::Test {
  test::TemporaryFolder folder;
  ArchiveLimits limits;

  static InstanceName name_of(const ImageText& text) {
    return {text.sop_class, text.instance, UID_LittleEndianExplicitTransferSyntax};
  }
  StoreOutcome store(InstanceStore& into, const ImageText& text, const InstanceName& name) {
    into.begin(name);
    into.write(dataset_of(text));
    return into.finish();
  }
  StoreOutcome store(const ImageText& text, const InstanceName& name) {
    InstanceStore into(folder.path(), limits);
    return store(into, text, name);
  }
  // The files in the folder; nothing of a refused instance may be left.
  std::size_t files() const {
    std::size_t out = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder.path()))
      out += entry.is_regular_file() ? 1 : 0;
    return out;
  }
};

TEST_F(StoreTest, FileIsTheHeaderAndTheBytesThatCame) {
  const ImageText text;
  const StoreOutcome outcome = store(text, name_of(text));
  EXPECT_EQ(outcome.status, StoreStatus::kStored) << outcome.why;
  EXPECT_EQ(outcome.study, kStudy);
  const fs::path file = folder.path() / kStudy / "2.25.1.1.1.dcm";
  const auto bytes = dataset_of(text);
  EXPECT_EQ(read_text(file), file_header(name_of(text)) + std::string(bytes.begin(), bytes.end()));
  EXPECT_EQ(fs::status(file).permissions(), fs::perms::owner_read | fs::perms::owner_write);
  DcmFileFormat format;
  ASSERT_TRUE(format.loadFile(file.c_str()).good());
  OFString syntax;
  format.getMetaInfo()->findAndGetOFString(DCM_TransferSyntaxUID, syntax);
  EXPECT_EQ(syntax, UID_LittleEndianExplicitTransferSyntax);
}

TEST_F(StoreTest, RefusesNamesThatAreNoUids) {
  for (const char* name : {"../../x", "/tmp/x", "..", "1.2/3", ""}) {
    ImageText text;
    text.instance = name;
    EXPECT_EQ(store(text, name_of(text)).status, StoreStatus::kNotUnderstood) << name;
    text = {};
    text.study = name;
    EXPECT_EQ(store(text, name_of(text)).status, StoreStatus::kNotUnderstood) << name;
    text = {};
    text.series = name;
    EXPECT_EQ(store(text, name_of(text)).status, StoreStatus::kNotUnderstood) << name;
  }
  EXPECT_EQ(files(), 0U);
}

TEST_F(StoreTest, RefusesWhatIsNotAnnounced) {
  const ImageText text;
  InstanceName other = name_of(text);
  other.sop_instance = "1.2.3";
  EXPECT_EQ(store(text, other).status, StoreStatus::kMismatch);
  other = name_of(text);
  other.sop_class = UID_MRImageStorage;
  EXPECT_EQ(store(text, other).status, StoreStatus::kMismatch);
  ImageText report;
  report.sop_class = "1.2.840.10008.5.1.4.1.1.88.11";  // a text, not an image
  EXPECT_EQ(store(report, name_of(report)).status, StoreStatus::kMismatch);
  EXPECT_EQ(files(), 0U);
}

TEST_F(StoreTest, RefusesDamagedAndEmptyImages) {
  ImageText text;
  text.has_pixels = false;
  EXPECT_EQ(store(text, name_of(text)).status, StoreStatus::kMismatch);
  text = {};
  text.rows = 0;
  EXPECT_EQ(store(text, name_of(text)).status, StoreStatus::kMismatch);
  const auto bytes = dataset_of({});
  InstanceStore into(folder.path(), limits);
  into.begin(name_of({}));
  into.write({bytes.data(), bytes.size() - 6});
  EXPECT_EQ(into.finish().status, StoreStatus::kNotUnderstood);
  EXPECT_EQ(files(), 0U);
}

TEST_F(StoreTest, LimitsTheInstance) {
  const auto bytes = dataset_of({});
  for (const std::size_t limit : {bytes.size() - 1, bytes.size()}) {
    limits.instance_bytes = limit;
    InstanceStore into(folder.path(), limits);
    into.begin(name_of({}));
    EXPECT_TRUE(into.write(bytes));
    EXPECT_EQ(into.finish().status,
              limit < bytes.size() ? StoreStatus::kOutOfResources : StoreStatus::kStored);
  }
  limits.instance_bytes = 100;
  InstanceStore into(folder.path(), limits);
  into.begin(name_of({}));
  EXPECT_TRUE(into.write(std::vector<std::uint8_t>(200)));
  EXPECT_FALSE(into.write(std::vector<std::uint8_t>(1)));  // more than twice the limit
  EXPECT_LE(fs::file_size(folder.path() / "arriving.part"), 100 + file_header(name_of({})).size());
}

TEST_F(StoreTest, LimitsTheStudyWithWhatIsThere) {
  limits.study_instances = 3;
  InstanceStore into(folder.path(), limits, [](const std::string&) { return StudySize{1, 10}; });
  for (const int k : {1, 2, 3}) {
    ImageText text;
    text.instance = "2.25.1.1." + std::to_string(k);
    EXPECT_EQ(store(into, text, name_of(text)).status,
              k <= 2 ? StoreStatus::kStored : StoreStatus::kOutOfResources);
  }
  EXPECT_EQ(files(), 2U);
}

TEST_F(StoreTest, InstanceThatIsStoredAlreadyDoesNotCountTwice) {
  limits.study_instances = 2;
  const std::uint64_t bytes = file_header(name_of({})).size() + dataset_of({}).size();
  InstanceStore into(
      folder.path(), limits,
      [](const std::string&) {
        return StudySize{2, 10};
      },
      [bytes](const std::string& study, const std::string& name, std::uint64_t size) {
        return study == kStudy && name == "2.25.1.1.1.dcm" && size == bytes;
      });
  ImageText text;
  EXPECT_EQ(store(into, text, name_of(text)).status, StoreStatus::kStored);
  text.instance = "2.25.1.1.2";
  EXPECT_EQ(store(into, text, name_of(text)).status, StoreStatus::kOutOfResources);
}

TEST_F(StoreTest, LimitsTheBytesOfAStudy) {
  limits.study_bytes = 2 * dataset_of({}).size() - 1;
  InstanceStore into(folder.path(), limits);
  ImageText text;
  EXPECT_EQ(store(into, text, name_of(text)).status, StoreStatus::kStored);
  text.instance = "2.25.1.1.2";
  EXPECT_EQ(store(into, text, name_of(text)).status, StoreStatus::kOutOfResources);
}

TEST_F(StoreTest, SameInstanceTwiceIsStoredOnceAndAnotherIsRefused) {
  InstanceStore into(folder.path(), limits);
  const ImageText text;
  EXPECT_EQ(store(into, text, name_of(text)).status, StoreStatus::kStored);
  EXPECT_EQ(store(into, text, name_of(text)).status, StoreStatus::kStored);
  const std::string before = read_text(folder.path() / kStudy / "2.25.1.1.1.dcm");
  ImageText changed;
  changed.rows = 8;
  EXPECT_EQ(store(into, changed, name_of(changed)).status, StoreStatus::kDuplicate);
  EXPECT_EQ(read_text(folder.path() / kStudy / "2.25.1.1.1.dcm"), before);
  EXPECT_EQ(files(), 1U);
}

TEST_F(StoreTest, UnwritableFolderIsThisComputersFault) {
  fs::create_directory(folder.path() / "arriving.part");  // the file cannot be made
  const StoreOutcome outcome = store({}, name_of({}));
  EXPECT_EQ(outcome.status, StoreStatus::kOutOfResources);
  EXPECT_TRUE(outcome.is_ours);
}

}  // namespace
}  // namespace trocar::archive
