// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/run_json.h"

#include "camera/lens_models.h"
#include "platform/process.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>

namespace dsorb {

const char* name(RunStatus status) {
  constexpr std::array<const char*, 6> kNames = {
      "tracked", "partly_tracked", "lost", "never_initialized", "interrupted", "error"};
  return kNames.at(static_cast<std::size_t>(status));
}

namespace io {

namespace {

constexpr double kSigmas = 3;  // that a readout must differ from none by

/// Last line of camera.txt: a readout that shows, "auto" for one that does not; none of a global
/// shutter.
std::string readoutLine(const Lens& lens) {
  const auto [seconds, sigma] = lens.readout;
  if (!lens.readout.isRolling()) return {};
  const bool shows = std::abs(seconds) > kSigmas * sigma;
  const std::string milliseconds =
      fmt::format("{:.4g}", lens.backwards ? -1000 * seconds : 1000 * seconds);
  return fmt::format(
      "readout {}{}\n", shows ? milliseconds : "auto", lens.columns ? " columns" : "");
}

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

std::string calibrationFile(const Lens& lens) {
  const std::string numbers = fmt::format("{} {} {} {}", lens.fx, lens.fy, lens.cx, lens.cy);
  const std::string size = fmt::format("{} {}\n", lens.width, lens.height);
  const auto& k = lens.coefficients;
  const std::string model =
      lens.model == LensModel::kRadTan
          ? fmt::format("RadTan {} {} {} {} {} {}\n", numbers, k[0], k[1], k[2], k[3], k[4]) +
                size + "crop\n"
          : "Pinhole " + numbers + " 0\n" + size + "none\n";
  return model + size + readoutLine(lens);
}

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

/// The camera and, where the window estimates it, how sure that is.
Json refinedJson(const RunCameras& cameras) {
  const auto& [camera, sigmas, radial, moved, segment] = cameras.refined.estimate();
  Json json = cameraJson(*camera);
  if (!sigmas) return json;
  json["sigma"] = {
      {"fx", (*sigmas)[0]}, {"fy", (*sigmas)[1]}, {"cx", (*sigmas)[2]}, {"cy", (*sigmas)[3]}};
  if (radial) {
    json["k1"] = radial->k1;
    json["sigma"]["k1"] = radial->sigma;
  }
  json["moved"] = moved;
  json["settled"] = cameras.areSettled();
  return json;
}

Json foundJson(const FoundCamera& found) {
  Json json = lensJson(found.lens);
  json["readout"] = 1000 * found.lens.readout.seconds;
  json["sigma"] = {{"focal", found.lens.fx * found.lens.focal_sigma},
                   {"center", found.center_sigma},
                   {"k1", found.k1_sigma},
                   {"readout", 1000 * found.lens.readout.sigma}};
  json["views"] = found.views;
  json["corners"] = found.corners;
  json["error"] = found.error;
  json["known"] = found.isKnown();
  if (found.focal_change_sigma > 0) {
    json["focal_change"] = {{"relative", found.focal_change},
                            {"sigma", found.focal_change_sigma},
                            {"contradicts_one_camera", found.changes()}};
    json["image_shift"] = {{"rms", found.shift}, {"contradicts_one_camera", found.isStabilized()}};
  }
  json["text"] = describe(found);
  return json;
}

/// What a start holds against the readout and a window against the lens.
void addDoubts(const RunRecord& record, Json& json) {
  if (const std::optional<Readout>& suspected = record.facts().suspected_readout) {
    json["rolling_shutter_suspected"] = {{"milliseconds", 1000 * suspected->seconds},
                                         {"sigma", 1000 * suspected->sigma}};
  }
  if (const std::optional<CameraScore>& camera = record.facts().contradicted_camera) {
    const CameraScore parts = camera->contradicting();
    Json& suspected = json["calibration_suspected"];
    if (parts.focal_sigma > 0) {
      suspected["focal_change"] = parts.focal_change;
      suspected["focal_sigma"] = parts.focal_sigma;
    }
    if (parts.radial.sigma > 0) {
      suspected["radial"] = parts.radial.k1;
      suspected["radial_sigma"] = parts.radial.sigma;
    }
  }
  if (record.facts().stuck_share > 0) json["stuck_share"] = record.facts().stuck_share;
}

}  // namespace

Json runJson(const RunInfo& info,
             const RunCameras& cameras,
             const RunRecord& record,
             const RunEnd& end) {
  const RunFacts& facts = record.facts();
  Json json = {{"program", info.program},
               {"version", info.version},
               {"dataset", info.dataset},
               {"initializer", info.initializer},
               {"camera", nullptr}};
  if (!isUtf8(info.dataset)) json["dataset_uri"] = fileUri(info.dataset);
  if (cameras.lens) json["lens"] = lensJson(*cameras.lens);
  if (cameras.camera) json["camera"] = cameraJson(*cameras.camera);
  const std::optional<PinholeCamera>& refined = cameras.refined.estimate().camera;
  if (cameras.camera && refined && refined->matrix() != cameras.camera->matrix()) {
    json["refined_camera"] = refinedJson(cameras);
  }
  if (cameras.found) json["found_camera"] = foundJson(*cameras.found);
  if (cameras.readout) {
    json["readout"] = {{"milliseconds", 1000 * cameras.readout->seconds},
                       {"sigma", 1000 * cameras.readout->sigma}};
  }
  addDoubts(record, json);
  json["frames_given"] = facts.frames_given;
  json["frames_tracked"] = facts.frames_tracked;
  json["frames_missed"] = facts.frames_missed;
  json["frames_dropped"] = end.frames_dropped;
  if (!end.unreadable.empty()) json["unreadable"] = end.unreadable;
  json["keyframes"] = record.keyframes().size();
  json["segments"] = facts.segments.size();
  json["units"] = Json::array();
  for (std::size_t i = 0; i < facts.units.size(); ++i) {
    Json unit = {{"segment", facts.segments[i]}, {"unit", "free"}};
    if (const auto& metric = facts.units[i]) {
      unit["unit"] = "metre";
      unit["relative_sigma"] = metric->relative_sigma;
    }
    json["units"].push_back(std::move(unit));
  }
  for (const SegmentsJoined& joined : record.changes().joins) {
    const Eigen::Vector3d& t = joined.S_into_segment.motion.translation();
    const Eigen::Vector4d q = joined.S_into_segment.motion.unitQuaternion().coeffs();
    const auto sigma = [&](int i) { return std::sqrt(joined.covariance(i, i)); };
    json["joined"].push_back(
        {{"segment", joined.segment},
         {"into", joined.into},
         {"scale", joined.S_into_segment.scale},
         {"pose", {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}},
         {"sigmas", {sigma(0), sigma(1), sigma(2), sigma(3), sigma(4), sigma(5), sigma(6)}},
         {"keyframes", joined.keyframes},
         {"matches", joined.matches},
         {"wrong_probability", joined.wrong_probability}});
  }
  for (const LoopsClosed& closed : record.changes().loops) {
    json["loops"].push_back({{"segment", closed.segment}, {"loops", closed.loops}});
  }
  json["refused"] = Json::object();
  for (const RefusalReason reason :
       {RefusalReason::kAdjustment, RefusalReason::kDirection, RefusalReason::kDepth}) {
    const auto count = facts.refusals.find(reason);
    json["refused"][name(reason)] = count == facts.refusals.end() ? 0 : count->second;
  }
  json["answers"] = Json::object();
  for (const auto& [reason, count] : facts.answers) json["answers"][name(reason)] = count;
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
