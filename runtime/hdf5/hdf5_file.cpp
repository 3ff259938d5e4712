// SPDX-License-Identifier: Apache-2.0
#include "runtime/hdf5/hdf5_file.h"

#include <hdf5.h>

#include <algorithm>
#include <array>
#include <utility>

namespace trocar::runtime {
namespace {

static_assert(sizeof(hid_t) == sizeof(std::int64_t));

// A chunk is what a reader decompresses at least: about four seconds at 1 kHz.
constexpr hsize_t kChunkRows = 4096;
constexpr unsigned kDeflateLevel = 6;
constexpr std::size_t kMemoryStep = std::size_t{1} << 20;

/// An identifier of libhdf5, which is closed at the end. A negative identifier means that a call has failed.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() {
    if (is_open()) close_(id_);
  }
  bool is_open() const { return id_ >= 0; }
  hid_t id() const { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

struct ElementType {
  hid_t in_file, in_memory;
};
ElementType element_type(Hdf5Type type) {
  switch (type) {
    case Hdf5Type::kFloat64:
      return {H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE};
    case Hdf5Type::kInt32:
      return {H5T_STD_I32LE, H5T_NATIVE_INT32};
    case Hdf5Type::kInt64:
      return {H5T_STD_I64LE, H5T_NATIVE_INT64};
    case Hdf5Type::kUint32:
      return {H5T_STD_U32LE, H5T_NATIVE_UINT32};
    case Hdf5Type::kUint8:
      break;
  }
  return {H5T_STD_U8LE, H5T_NATIVE_UINT8};
}

/// The type of an enumeration with these names. The result is negative if a call fails.
hid_t enumeration_of(const std::vector<std::string>& names) {
  const hid_t type = H5Tenum_create(H5T_STD_U8LE);
  for (std::size_t i = 0; i < names.size() && type >= 0; ++i) {
    const auto value = static_cast<std::uint8_t>(i);
    if (H5Tenum_insert(type, names[i].c_str(), &value) >= 0) continue;
    H5Tclose(type);
    return -1;
  }
  return type;
}

/// Adds an attribute to an object of the file. `space` says how many texts there are.
bool write_texts(hid_t file, const std::string& object, const std::string& name,
                 const Handle& space, const char* const* texts) {
  const Handle owner(H5Oopen(file, object.c_str(), H5P_DEFAULT), H5Oclose);
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  const bool ok =
      H5Tset_size(type.id(), H5T_VARIABLE) >= 0 && H5Tset_cset(type.id(), H5T_CSET_UTF8) >= 0;
  const Handle attribute(
      H5Acreate2(owner.id(), name.c_str(), type.id(), space.id(), H5P_DEFAULT, H5P_DEFAULT),
      H5Aclose);
  return ok && H5Awrite(attribute.id(), type.id(), texts) >= 0;
}

}  // namespace

Hdf5File::Hdf5File() {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // failures are reported by bytes()
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  has_failed_ = H5Pset_fapl_core(access.id(), kMemoryStep, 0) < 0;
  file_ = H5Fcreate("in memory", H5F_ACC_TRUNC, H5P_DEFAULT, access.id());
  has_failed_ = has_failed_ || file_ < 0;
}

Hdf5File::~Hdf5File() {
  if (file_ >= 0) H5Fclose(file_);
}

void Hdf5File::add(const Hdf5Table& table) {
  const ElementType plain = element_type(table.type);
  const hsize_t rows = table.data.size() / (table.width * H5Tget_size(plain.in_memory));
  const std::array<hsize_t, 2> size = {rows, table.width},
                               chunk = {std::min(rows, kChunkRows), table.width};
  const int dimensions = table.width == 1 ? 1 : 2;
  const Handle space(H5Screate_simple(dimensions, size.data(), nullptr), H5Sclose);
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  bool ok = H5Pset_obj_track_times(properties.id(), false) >= 0 &&
            H5Pset_chunk(properties.id(), dimensions, chunk.data()) >= 0 &&
            H5Pset_shuffle(properties.id()) >= 0 &&
            H5Pset_deflate(properties.id(), kDeflateLevel) >= 0;
  const bool is_enumeration = !table.enumerators.empty();
  const Handle enumeration(is_enumeration ? enumeration_of(table.enumerators) : -1, H5Tclose);
  const hid_t in_file = is_enumeration ? enumeration.id() : plain.in_file;
  const Handle dataset(H5Dcreate2(file_, table.name.c_str(), in_file, space.id(), H5P_DEFAULT,
                                  properties.id(), H5P_DEFAULT),
                       H5Dclose);
  ok = ok && dataset.is_open() &&
       H5Dwrite(dataset.id(), is_enumeration ? in_file : plain.in_memory, H5S_ALL, H5S_ALL,
                H5P_DEFAULT, table.data.data()) >= 0;
  has_failed_ = has_failed_ || !ok;
}

void Hdf5File::set_attribute(const std::string& object, const std::string& name,
                             const std::string& text) {
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const char* const value = text.c_str();
  has_failed_ = !write_texts(file_, object, name, space, &value) || has_failed_;
}

void Hdf5File::set_attribute(const std::string& object, const std::string& name,
                             std::span<const std::string> texts) {
  const hsize_t count = texts.size();
  const Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose);
  std::vector<const char*> values;
  for (const std::string& text : texts)
    values.push_back(text.c_str());
  has_failed_ = !write_texts(file_, object, name, space, values.data()) || has_failed_;
}

Result<std::vector<std::uint8_t>> Hdf5File::bytes() {
  const ssize_t size = has_failed_ || H5Fflush(file_, H5F_SCOPE_LOCAL) < 0
                           ? -1
                           : H5Fget_file_image(file_, nullptr, 0);
  if (size <= 0) return bug("libhdf5 could not make the file");
  std::vector<std::uint8_t> image(static_cast<std::size_t>(size));
  if (H5Fget_file_image(file_, image.data(), image.size()) != size)
    return bug("libhdf5 could not make the file");
  return image;
}

std::string hdf5_version() {
  return std::to_string(H5_VERS_MAJOR) + "." + std::to_string(H5_VERS_MINOR) + "." +
         std::to_string(H5_VERS_RELEASE);
}

}  // namespace trocar::runtime
