// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/igtl/igtl_messages.h"

#include <igtlPolyDataMessage.h>
#include <igtlSensorMessage.h>
#include <igtlStatusMessage.h>
#include <igtlTransformMessage.h>
#include <igtlUnit.h>

#include <cmath>

namespace trocar::runtime {
namespace {

std::string packed(igtl::MessageBase& message, IgtlStamp stamp) {
  constexpr double kFractions = 4294967296.0;  // a second is 2^32 units of the time stamp
  const double whole_s = std::floor(stamp.unix_s);
  message.SetDeviceName(stamp.name);
  message.SetTimeStamp(static_cast<unsigned>(whole_s),
                       static_cast<unsigned>((stamp.unix_s - whole_s) * kFractions));
  message.Pack();
  return {static_cast<const char*>(message.GetPackPointer()),
          static_cast<std::size_t>(message.GetPackSize())};
}

}  // namespace

std::string transform_message(IgtlStamp stamp, const Eigen::Affine3d& T_mm) {
  const igtl::TransformMessage::Pointer message = igtl::TransformMessage::New();
  igtl::Matrix4x4 matrix;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j)
      matrix[i][j] = static_cast<float>(T_mm.matrix()(i, j));
  }
  message->SetMatrix(matrix);
  return packed(*message, stamp);
}

std::string sensor_message(IgtlStamp stamp, std::span<const double> values, IgtlUnit unit) {
  const igtl::SensorMessage::Pointer message = igtl::SensorMessage::New();
  const igtl::Unit::Pointer packed_unit = igtl::Unit::New();
  packed_unit->Append(
      unit == IgtlUnit::kNewton ? igtl::Unit::SI_DERIVED_NEWTON : igtl::Unit::SI_BASE_SECOND, 1);
  message->SetLength(static_cast<unsigned>(values.size()));
  message->SetUnit(packed_unit->Pack());
  for (std::size_t i = 0; i < values.size(); ++i)
    message->SetValue(static_cast<unsigned>(i), values[i]);
  return packed(*message, stamp);
}

std::string status_message(IgtlStamp stamp, IgtlStatus code, const std::string& error,
                           const std::string& text) {
  const igtl::StatusMessage::Pointer message = igtl::StatusMessage::New();
  message->SetCode(static_cast<int>(code));
  message->SetSubCode(0);  // the library does not initialise it
  message->SetErrorName(error.c_str());
  message->SetStatusString(text.c_str());
  return packed(*message, stamp);
}

std::string polydata_message(IgtlStamp stamp, std::span<const float> vertices_mm,
                             std::span<const std::uint32_t> triangles) {
  const igtl::PolyDataPointArray::Pointer points = igtl::PolyDataPointArray::New();
  points->SetNumberOfPoints(static_cast<int>(vertices_mm.size() / 3));
  for (std::size_t v = 0; v + 2 < vertices_mm.size(); v += 3)
    points->SetPoint(static_cast<unsigned>(v / 3), vertices_mm[v], vertices_mm[v + 1],
                     vertices_mm[v + 2]);
  const igtl::PolyDataCellArray::Pointer cells = igtl::PolyDataCellArray::New();
  for (std::size_t t = 0; t + 2 < triangles.size(); t += 3) {
    igtlUint32 cell[] = {triangles[t], triangles[t + 1], triangles[t + 2]};
    cells->AddCell(3, cell);
  }
  const igtl::PolyDataMessage::Pointer message = igtl::PolyDataMessage::New();
  message->SetPoints(points);
  message->SetPolygons(cells);
  return packed(*message, stamp);
}

}  // namespace trocar::runtime
