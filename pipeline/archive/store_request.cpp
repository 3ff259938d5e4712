// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/store_request.h"

#include <dcmtk/dcmdata/dcostrma.h>

#include <cstring>

namespace trocar::archive {
namespace {

// DCMTK writes the fragments of a dataset into this stream.
class StoreConsumer final : public DcmConsumer {
 public:
  StoreConsumer(InstanceStore& store, const std::function<bool()>& stop)
      : store_(store), stop_(stop) {}

  OFBool good() const override { return is_good_; }
  OFCondition status() const override { return is_good_ ? EC_Normal : EC_InvalidStream; }
  OFBool isFlushed() const override { return true; }
  offile_off_t avail() const override { return is_good_ ? 1 << 30 : 0; }
  offile_off_t write(const void* data, offile_off_t size) override {
    if (size <= 0 || !is_good_) return 0;
    is_good_ = !(stop_ && stop_()) && store_.write({static_cast<const std::uint8_t*>(data),
                                                    static_cast<std::size_t>(size)});
    return is_good_ ? size : 0;
  }
  void flush() override {}

 private:
  InstanceStore& store_;
  const std::function<bool()>& stop_;
  bool is_good_ = true;
};

class StoreStream final : public DcmOutputStream {
 public:
  StoreStream(InstanceStore& store, const std::function<bool()>& stop)
      : DcmOutputStream(&consumer_), consumer_(store, stop) {}

 private:
  StoreConsumer consumer_;
};

}  // namespace

OFCondition send_store_response(T_ASC_Association& association, T_ASC_PresentationContextID context,
                                const T_DIMSE_C_StoreRQ& request, StoreStatus status) {
  T_DIMSE_C_StoreRSP response{};
  response.MessageIDBeingRespondedTo = request.MessageID;
  response.DimseStatus = static_cast<DIC_US>(status);
  response.DataSetType = DIMSE_DATASET_NULL;
  std::memcpy(response.AffectedSOPClassUID, request.AffectedSOPClassUID,
              sizeof response.AffectedSOPClassUID);
  std::memcpy(response.AffectedSOPInstanceUID, request.AffectedSOPInstanceUID,
              sizeof response.AffectedSOPInstanceUID);
  response.opts = O_STORE_AFFECTEDSOPCLASSUID | O_STORE_AFFECTEDSOPINSTANCEUID;
  return DIMSE_sendStoreResponse(&association, context, &request, &response, nullptr);
}

StoreAnswer answer_store_request(T_ASC_Association& association,
                                 T_ASC_PresentationContextID context,
                                 const T_DIMSE_C_StoreRQ& request, InstanceStore& store,
                                 int timeout_s, const std::function<bool()>& stop) {
  StoreAnswer out;
  T_ASC_PresentationContext accepted;
  out.network = ASC_findAcceptedPresentationContext(association.params, context, &accepted);
  if (out.network.bad()) return out;
  if (request.DataSetType == DIMSE_DATASET_NULL) {
    out.outcome = {StoreStatus::kNotUnderstood, "no dataset follows the request"};
    out.network = send_store_response(association, context, request, out.outcome.status);
    return out;
  }
  // No class is storable if the command names another one than its presentation context.
  const bool is_same = std::strcmp(accepted.abstractSyntax, request.AffectedSOPClassUID) == 0;
  store.begin({is_same ? request.AffectedSOPClassUID : "", request.AffectedSOPInstanceUID,
               accepted.acceptedTransferSyntax});
  StoreStream stream(store, stop);
  T_ASC_PresentationContextID data_context = context;
  out.network = DIMSE_receiveDataSetInFile(&association, DIMSE_NONBLOCKING, timeout_s,
                                           &data_context, &stream, nullptr, nullptr);
  if (out.network.bad()) return out;
  if (data_context != context) {
    out.network = DIMSE_BADMESSAGE;
    return out;
  }
  out.outcome = store.finish();
  out.network = send_store_response(association, context, request, out.outcome.status);
  return out;
}

}  // namespace trocar::archive
