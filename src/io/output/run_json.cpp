// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/run_json.h"

#include "camera/lens_models.h"
#include "platform/process.h"

#include <fmt/format.h>

#include <cctype>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

namespace dsorb {

const char* name(RunStatus status) {
  switch (status) {
    case RunStatus::kTracked:
      return "tracked";
    case RunStatus::kLost:
      return "lost";
    case RunStatus::kNeverInitialized:
      return "never_initialized";
    case RunStatus::kInterrupted:
      return "interrupted";
    case RunStatus::kError:
      return "error";
  }
  return "error";
}

namespace io {
namespace {

bool isUtf8(const std::string& text) {
  try {
    return !Json(text).dump().empty();
  } catch (const Json::type_error&) {
    return false;
  }
}

/// RFC 8089; names of files may hold any bytes.
std::string fileUri(const std::string& path) {
  std::string uri = "file://";
  for (const char c : path) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) != 0 || std::strchr("/-._~", c);
    uri += plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return uri;
}

}  // namespace

Json cameraJson(const PinholeCamera& camera) {
  return {{"fx", camera.fx},
          {"fy", camera.fy},
          {"cx", camera.cx},
          {"cy", camera.cy},
          {"width", camera.width},
          {"height", camera.height}};
}

Json lensJson(const Lens& lens) {
  return {{"model", nameOf(lens.model).name},
          {"fx", lens.fx},
          {"fy", lens.fy},
          {"cx", lens.cx},
          {"cy", lens.cy},
          {"coefficients", coefficientsOf(lens)},
          {"width", lens.width},
          {"height", lens.height}};
}

namespace {

/// What starts and windows hold against the camera.
void addDoubts(const RunRecord& record, Json& json) {
  if (const std::optional<Readout>& suspected = record.suspectedReadout()) {
    json["rolling_shutter_suspected"] = {{"milliseconds", 1000 * suspected->seconds},
                                         {"sigma", 1000 * suspected->sigma}};
  }
  if (const std::optional<LensScore>& lens = record.contradictedLens()) {
    json["calibration_suspected"] = {
        {"gain", lens->gain}, {"focal_factor", lens->focal_factor}, {"radial", lens->radial}};
  }
  if (const std::optional<CameraScore>& camera = record.contradictedCamera()) {
    const CameraScore parts = camera->contradicting();
    Json& window = json["calibration_suspected"]["window"];
    if (parts.focal_sigma > 0) {
      window["focal_change"] = parts.focal_change;
      window["focal_sigma"] = parts.focal_sigma;
    }
    if (parts.radial.sigma > 0) {
      window["radial"] = parts.radial.k1;
      window["radial_sigma"] = parts.radial.sigma;
    }
  }
  if (record.stuckShare() > 0) json["stuck_share"] = record.stuckShare();
}

}  // namespace

Json runJson(const RunInfo& info,
             const RunCameras& cameras,
             const RunRecord& record,
             const RunEnd& end) {
  Json json = {{"program", info.program},
               {"version", info.version},
               {"dataset", info.dataset},
               {"initializer", info.initializer},
               {"camera", nullptr}};
  if (!isUtf8(info.dataset)) json["dataset_uri"] = fileUri(info.dataset);
  if (cameras.lens) json["lens"] = lensJson(*cameras.lens);
  if (cameras.camera) json["camera"] = cameraJson(*cameras.camera);
  const std::optional<PinholeCamera>& refined = cameras.refined.camera();
  if (cameras.camera && refined && refined->matrix() != cameras.camera->matrix()) {
    json["refined_camera"] = cameras.refined.json();
  }
  if (cameras.readout) {
    json["readout"] = {{"milliseconds", 1000 * cameras.readout->seconds},
                       {"sigma", 1000 * cameras.readout->sigma}};
  }
  addDoubts(record, json);
  json["frames_given"] = record.notes().size();
  json["frames_tracked"] = record.framesTracked();
  json["frames_missed"] = record.framesMissed();
  json["frames_dropped"] = end.frames_dropped;
  if (!end.unreadable.empty()) json["unreadable"] = end.unreadable;
  json["keyframes"] = record.keyframes().size();
  json["segments"] = record.segments().size();
  json["units"] = Json::array();
  for (std::size_t i = 0; i < record.units().size(); ++i) {
    Json unit = {{"segment", record.segments()[i]}, {"unit", "free"}};
    if (const auto& metric = record.units()[i]) {
      unit["unit"] = "metre";
      unit["relative_sigma"] = metric->relative_sigma;
    }
    json["units"].push_back(std::move(unit));
  }
  json["withdrawn"] = Json::object();
  for (const RefusalReason reason :
       {RefusalReason::kAdjustment, RefusalReason::kDirection, RefusalReason::kDepth}) {
    json["withdrawn"][name(reason)] = record.refusals(reason);
  }
  json["answers"] = Json::object();
  for (const auto& [reason, count] : record.answers()) json["answers"][name(reason)] = count;
  json["status"] = name(end.status);
  json["seconds"] = {{"total", end.seconds.total},
                     {"reading", end.seconds.reading},
                     {"initializing", end.seconds.initializing},
                     {"tracking", end.seconds.tracking},
                     {"mapping", end.seconds.mapping},
                     {"writing", end.seconds.writing}};
  json["peak_memory_mb"] = platform::peakMemory();
  json["threads"] = info.threads;
  return json;
}

}  // namespace io
}  // namespace dsorb
