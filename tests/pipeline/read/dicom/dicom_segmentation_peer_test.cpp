// SPDX-License-Identifier: GPL-3.0-or-later
// Segmentations that DCMTK's own writer (libdcmseg) packs: an implementation that is not ours.
#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmfg/fgfracon.h>
#include <dcmtk/dcmfg/fgpixmsr.h>
#include <dcmtk/dcmfg/fgplanor.h>
#include <dcmtk/dcmfg/fgplanpo.h>
#include <dcmtk/dcmseg/segdoc.h>
#include <dcmtk/dcmseg/segment.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <vector>

#include "pipeline/open/open_stack.h"
#include "pipeline/read/slice_stack.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

// Frames of whole bytes: of others libdcmseg 3.6.7 spoils the bits, from the third frame on.
constexpr int kWidth = 16, kHeight = 7, kSlices = 5;

bool inside(int segment, int x, int y, int slice) {
  return slice != 2 && (segment == 1 ? x < 4 + slice && y > 1 : x > 8 && (x + y * slice) % 3 != 0);
}

// A writer that was made with the dimensions and segments that all segmentations need.
std::unique_ptr<DcmSegmentation> made(bool is_binary) {
  const IODGeneralEquipmentModule::EquipmentInfo equipment("Maker", "Model", "1", "1");
  const ContentIdentificationMacro content("1", "LABELS", "Labels", "Nobody");
  DcmSegmentation* raw = nullptr;
  const OFCondition ok =
      is_binary
          ? DcmSegmentation::createBinarySegmentation(raw, kHeight, kWidth, equipment, content)
          : DcmSegmentation::createFractionalSegmentation(
                raw, kHeight, kWidth, DcmSegTypes::SFT_OCCUPANCY, 200, equipment, content);
  EXPECT_TRUE(ok.good()) << ok.text();
  std::unique_ptr<DcmSegmentation> out(raw);
  const std::unique_ptr<FGPlaneOrientationPatient> orientation(
      FGPlaneOrientationPatient::createMinimal("1", "0", "0", "0", "1", "0"));
  EXPECT_TRUE(out->addForAllFrames(*orientation).good());
  FGPixelMeasures measures;
  measures.setPixelSpacing("0.5\\0.75");
  measures.setSliceThickness("1.25");
  measures.setSpacingBetweenSlices("1.25");
  EXPECT_TRUE(out->addForAllFrames(measures).good());
  out->getFrameOfReference().setFrameOfReferenceUID("1.2.826.0.1.3680043.10.8");
  out->getStudy().setStudyInstanceUID("1.2.826.0.1.3680043.10.9");
  out->getSeries().setSeriesInstanceUID("1.2.826.0.1.3680043.10.77");
  out->getSeries().setSeriesNumber("5");
  IODMultiframeDimensionModule& dimensions = out->getDimensions();
  dimensions.addDimensionIndex(DCM_ReferencedSegmentNumber, "1.2.826.0.1.3680043.10.7",
                               DCM_SegmentIdentificationSequence, "Segment");
  dimensions.addDimensionIndex(DCM_ImagePositionPatient, "1.2.826.0.1.3680043.10.7",
                               DCM_PlanePositionSequence, "Position");
  for (const char* name : {"L1", "Disc"}) {
    const CodeSequenceMacro category("123037004", "SCT", "Anatomical Structure"),
        type("51282000", "SCT", "Vertebra");
    DcmSegment* segment = nullptr;
    EXPECT_TRUE(
        DcmSegment::create(segment, name, category, type, DcmSegTypes::SAT_MANUAL, "").good());
    Uint16 number = 0;
    EXPECT_TRUE(out->addSegment(segment, number).good());
  }
  return out;
}

void add_frame(DcmSegmentation& to, Uint16 segment, int slice, Uint8 value) {
  std::vector<Uint8> pixels;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      pixels.push_back(inside(segment, x, y, slice) ? value : Uint8{0});
  }
  FGFrameContent content;
  content.setStackID("1");
  content.setInStackPositionNumber(static_cast<Uint32>(slice) + 1);
  content.setDimensionIndexValues(segment, 0);
  content.setDimensionIndexValues(static_cast<Uint32>(slice) + 1, 1);
  const std::unique_ptr<FGPlanePosPatient> position(
      FGPlanePosPatient::createMinimal("-10", "20", std::to_string(5 + 1.25 * slice).c_str()));
  OFVector<FGBase*> groups;
  groups.push_back(&content);
  groups.push_back(position.get());
  const OFCondition ok = to.addFrame(pixels.data(), segment, groups);
  EXPECT_TRUE(ok.good()) << ok.text();
}

class Peer : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(BinaryAndFractional, Peer, testing::Bool());

TEST_P(Peer, FramesOfDcmtksWriterAreTheLabels) {
  const auto seg = made(GetParam());
  for (int slice = kSlices - 1; slice >= 0; --slice) {
    for (const Uint16 segment : {Uint16{1}, Uint16{2}}) {
      // Half of 200 and more counts.
      if (slice != 2) add_frame(*seg, segment, slice, GetParam() ? 1 : segment == 1 ? 100 : 200);
    }
  }
  const std::filesystem::path file = std::filesystem::temp_directory_path() /
                                     ("trocar_peer_" + std::to_string(::getpid()) + ".dcm");
  const OFCondition saved = seg->saveFile(file.c_str(), EXS_LittleEndianExplicit);
  ASSERT_TRUE(saved.good()) << saved.text();

  OpenOptions options;
  options.as_labels = true;
  const auto stack = test::take(open_stack({file}, options));
  EXPECT_EQ(stack->label_names, (std::map<int, std::string>{{1, "L1"}, {2, "Disc"}}));
  ASSERT_EQ(stack->size(), kSlices);
  ASSERT_EQ(stack->width(), kWidth);
  ASSERT_EQ(stack->height(), kHeight);
  for (int slice = 0; slice < kSlices; ++slice) {
    const Eigen::Vector3d at = stack->plane(slice).T_lps_plane.translation();
    EXPECT_LT((at - Eigen::Vector3d(-10, 20, 5 + 1.25 * slice)).norm(), 1e-9);
    const auto image = test::take(stack->read(slice));
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const float want = inside(1, x, y, slice) ? 1.0F : inside(2, x, y, slice) ? 2.0F : 0.0F;
        ASSERT_EQ(image.at(x, y), want) << x << ' ' << y << ' ' << slice;
      }
    }
  }
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace trocar::pipeline
