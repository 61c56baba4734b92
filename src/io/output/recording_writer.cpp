// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/recording_writer.h"

#include "dsorb/error.h"
#include "dsorb/init/metric_scale.h"

#include "io/output/figures.h"
#include "io/output/run_record.h"
#include "io/text_file.h"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

namespace dsorb::io {
namespace {

namespace fs = std::filesystem;

constexpr int kFormatVersion = 1;
constexpr const char* kFormat = "dsorb-recording";

Json poseOrNull(const std::optional<SE3>& T_world_cam) {
  return T_world_cam ? poseJson(*T_world_cam) : Json();
}

Json initLine(const InitStep& step, FrameId frame, int segment) {
  const char* status = step.status == InitStatus::kInitialized ? "initialized"
                       : step.status == InitStatus::kRestarted ? "restarted"
                                                               : "needs_more_frames";
  Json line = {{"kind", "init"},
               {"index", frame.value},
               {"segment", segment},
               {"status", status},
               {"reason", name(step.reason)}};
  if (!step.result) return line;
  line["reference"] = step.result->frames.front().frame->id().value;
  line["poses"] = Json::array();
  for (const PosedFrame& posed : step.result->frames) {
    const Json pose = posed.T_cam_ref ? poseJson(posed.T_cam_ref->inverse()) : Json();
    line["poses"].push_back(Json::array({posed.frame->id().value, pose}));
  }
  return line;
}

Json poseLine(const FrameEstimate& estimate) {
  const bool known = estimate.tracking_rmse && std::isfinite(*estimate.tracking_rmse);
  return {{"kind", "pose"},
          {"index", estimate.frame->id().value},
          {"timestamp", estimate.frame->timestamp()},
          {"segment", estimate.segment},
          {"state", name(estimate.state)},
          {"is_keyframe", estimate.is_keyframe},
          {"pose", poseOrNull(estimate.T_world_cam)},
          {"keyframe", estimate.keyframe ? Json(estimate.keyframe->value) : Json()},
          {"rmse", known ? Json(*estimate.tracking_rmse) : Json()},
          {"affine", {estimate.affine.a, estimate.affine.b}}};
}

Json keyframeLine(const KeyframeSnapshot& keyframe, bool final) {
  return {{"kind", "keyframe"},
          {"index", keyframe.id.value},
          {"timestamp", keyframe.timestamp},
          {"segment", keyframe.segment},
          {"final", final},
          {"pose", poseJson(keyframe.T_world_cam)},
          {"camera", cameraJson(keyframe.camera)}};
}

Json pointsLine(const KeyframeSnapshot& keyframe, bool final) {
  Json points = Json::array();
  for (const MapPoint& point : keyframe.points) {
    if (!point.pixel.allFinite() || !std::isfinite(point.inverse_depth) ||
        !std::isfinite(point.variance) || !std::isfinite(point.intensity)) {
      continue;
    }
    points.push_back({shortest(point.pixel.x()),
                      shortest(point.pixel.y()),
                      shortest(point.inverse_depth),
                      shortest(point.variance),
                      shortest(point.intensity)});
  }
  return {{"kind", "points"},
          {"keyframe", keyframe.id.value},
          {"segment", keyframe.segment},
          {"final", final},
          {"points", std::move(points)}};
}

Json headerLine(const RunInfo& info, const PinholeCamera& camera) {
  return {{"kind", "header"},
          {"format", kFormat},
          {"version", kFormatVersion},
          {"program", info.program + " " + info.version},
          {"dataset", info.dataset},
          {"initializer", info.initializer},
          {"camera", cameraJson(camera)}};
}

bool isRecording(const fs::path& path) {
  const std::string header = fmt::format(R"({{"kind":"header","format":"{}")", kFormat);
  std::string begin(header.size(), 0);
  std::ifstream(path).read(begin.data(), static_cast<std::streamsize>(begin.size()));
  return begin == header;
}

fs::path imageFolder(const fs::path& path) {
  return path.stem().string() + "_images";
}

/// The recording's path, once its folders are there.
/// @throws IoError where images would go among those of others
fs::path prepared(const fs::path& path) {
  const fs::path folder = fs::absolute(path).parent_path() / imageFolder(path);
  refuseOthers(path);
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw fileError(folder, "cannot be created: {}", error.message());
  if (!fs::is_symlink(folder) && (fs::is_empty(folder) || isRecording(path))) return path;
  throw fileError(folder,
                  "holds files of others, where the images of {} would go; choose another name "
                  "for the recording",
                  path.string());
}

}  // namespace

void refuseOthers(const fs::path& path) {
  std::error_code none;
  if (!fs::is_regular_file(path, none) || fs::file_size(path) == 0 || isRecording(path)) return;
  throw IoError(fmt::format(
      "--record {}: is no recording, and would be replaced; choose another name", path.string()));
}

RecordingWriter::RecordingWriter(const fs::path& path,
                                 const RunInfo& info,
                                 const PinholeCamera& camera)
    : file_(prepared(path)), folder_(fs::absolute(path).parent_path()), images_(imageFolder(path)) {
  writeLine(headerLine(info, camera));
}

void RecordingWriter::onInitStep(const InitStep& step, const Frame& frame, int segment) {
  InitStep told = step;
  if (told.result && told.result->metric) toMetres(*told.result->metric, *told.result);
  pending_.emplace_back([told, id = frame.id(), segment] { return initLine(told, id, segment); });
}

void RecordingWriter::onStartRefused(const StartRefusal& refusal) {
  pending_.emplace_back([refusal]() -> Json {
    return {{"kind", "refused"},
            {"index", refusal.frame.value},
            {"segment", refusal.segment},
            {"reason", name(refusal.reason)}};
  });
}

void RecordingWriter::onFrame(const FrameEstimate& estimate) {
  pending_.emplace_back([estimate] { return poseLine(estimate); });
}

void RecordingWriter::noteKeyframe(const KeyframeSnapshot& keyframe, bool final) {
  if (!isFinite(keyframe.T_world_cam)) return;
  pending_.emplace_back([keyframe, final] { return keyframeLine(keyframe, final); });
  pending_.emplace_back([keyframe, final] { return pointsLine(keyframe, final); });
}

void RecordingWriter::onLost(FrameId frame, int segment) {
  pending_.emplace_back([frame, segment]() -> Json {
    return {{"kind", "lost"}, {"index", frame.value}, {"segment", segment}};
  });
}

void RecordingWriter::frameDone(const FrameEstimate& estimate) {
  const Frame& frame = *estimate.frame;
  const fs::path image = images_ / fmt::format("{:06d}.png", frame.id().value);
  writePng(folder_ / image, greyImage(frame));
  writeLine({{"kind", "image"},
             {"index", frame.id().value},
             {"timestamp", frame.timestamp()},
             {"segment", estimate.segment},
             {"file", image.generic_string()},
             {"rectified", true}});
  writePending();
}

void RecordingWriter::finish(RunStatus status) {
  writePending();
  writeLine({{"kind", "end"}, {"status", name(status)}});
}

void RecordingWriter::writePending() {
  for (const auto& line : pending_) writeLine(line());
  pending_.clear();
}

void RecordingWriter::writeLine(const Json& line) {
  file_.append(line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace dsorb::io
