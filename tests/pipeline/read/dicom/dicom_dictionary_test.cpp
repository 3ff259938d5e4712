// SPDX-License-Identifier: GPL-3.0-or-later
// The elements that are known without DCMTK's dictionary, compared with that dictionary and with
// the source files.
#include "pipeline/read/dicom/dicom_parse.h"

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <string>

namespace trocar::pipeline {
namespace {

struct Dictionaries {
  DcmDataDictionary whole{OFTrue, OFTrue};  // before the environment says otherwise
  const DcmDataDictionary& known;
  Dictionaries() : known(without_file()) {}
  static const DcmDataDictionary& without_file() {
    leave_out_dicom_dictionary();
    add_known_dicom_elements();
    return dcmDataDict.rdlock();
  }
  ~Dictionaries() { dcmDataDict.rdunlock(); }
};

// The elements that the readers name, as in DCM_Rows.
std::set<std::string> named_in_sources() {
  std::set<std::string> out;
  const std::regex name("\\bDCM_([A-Z]\\w*)");
  for (const auto& entry : std::filesystem::recursive_directory_iterator(TROCAR_PIPELINE)) {
    if (!entry.is_regular_file() || entry.path().filename() == "dicom_dictionary.cpp") continue;
    std::ifstream in(entry.path());
    std::stringstream text;
    text << in.rdbuf();
    const std::string all = text.str();
    for (std::sregex_iterator at(all.begin(), all.end(), name), end; at != end; ++at)
      out.insert((*at)[1]);
  }
  out.erase("UndefinedTagKey");
  return out;
}

TEST(DicomDictionary, KnowsWhatIsReadAsTheWholeOneDoes) {
  const Dictionaries dictionaries;
  ASSERT_GT(dictionaries.whole.numberOfNormalTagEntries(), 4000);
  EXPECT_LT(dictionaries.known.numberOfNormalTagEntries(), 150);
  const std::set<std::string> names = named_in_sources();
  EXPECT_GT(names.size(), 40U);
  for (const std::string& name : names) {
    const DcmDictEntry* const expected = dictionaries.whole.findEntry(name.c_str());
    ASSERT_NE(expected, nullptr) << name;
    const DcmDictEntry* const known = dictionaries.known.findEntry(expected->getKey(), nullptr);
    ASSERT_NE(known, nullptr) << name;
    EXPECT_EQ(known->getEVR(), expected->getEVR()) << name;
  }
}

}  // namespace
}  // namespace trocar::pipeline
