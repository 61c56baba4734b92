// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/writers.h"

#include "dsorb/camera/pinhole_camera.h"

#include "base/timed.h"
#include "io/output/figures.h"
#include "io/output/output_file.h"
#include "io/output/run_files.h"
#include "io/output/run_json.h"
#include "io/output/run_record.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace dsorb {

namespace fs = std::filesystem;

namespace {

constexpr std::string_view kHead = "{\n \"initializations\": [";
constexpr std::string_view kTail = "]\n}\n";
constexpr int kDepth = 2;  // of an initialization in the file

template <typename Matrix>
io::Json rows(const Matrix& matrix) {
  io::Json result = io::Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    io::Json row = io::Json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
    result.push_back(std::move(row));
  }
  return result;
}

io::Json frameReference(const Frame& frame) {
  return {{"index", frame.id().value}, {"timestamp", frame.timestamp()}};
}

io::Json poses(const InitializationResult& result) {
  io::Json list = io::Json::array();
  for (const PosedFrame& posed : result.frames) {
    const bool known = posed.T_cam_ref && io::isFinite(*posed.T_cam_ref);
    const bool certain = known && posed.covariance && posed.covariance->allFinite();
    io::Json entry = frameReference(*posed.frame);
    entry["T_cam_ref"] = known ? rows(posed.T_cam_ref->matrix()) : io::Json();
    entry["affine"] = {posed.affine.a, posed.affine.b};
    entry["covariance"] = certain ? rows(*posed.covariance) : io::Json();
    list.push_back(std::move(entry));
  }
  return list;
}

/// Points hosted in the reference as [u, v, inverse depth, variance].
io::Json referencePoints(const InitializationResult& result) {
  io::Json list = io::Json::array();
  for (const InitPoint& point : result.points) {
    if (point.host != 0 || !point.pixel.allFinite() || !std::isfinite(point.inverse_depth) ||
        !std::isfinite(point.variance)) {
      continue;
    }
    list.push_back({io::shortest(point.pixel.x()),
                    io::shortest(point.pixel.y()),
                    io::shortest(point.inverse_depth),
                    io::shortest(point.variance)});
  }
  return list;
}

io::Json reportJson(const InitializationResult& result) {
  const InitReport& report = result.report;
  const auto posed = std::count_if(result.frames.begin(), result.frames.end(), [](const auto& f) {
    return f.T_cam_ref.has_value();
  });
  io::Json json = {{"model", report.model},
                   {"frames_fed", result.frames.size()},
                   {"frames_posed", posed},
                   {"restarts", report.restarts},
                   {"points", result.points.size()},
                   {"median_relative_sigma", report.median_relative_sigma}};
  const auto add = [&json](const char* name, const auto& value) {
    json[name] = value ? io::Json(*value) : io::Json(nullptr);
  };
  add("wrong_probability", report.wrong_probability);
  add("known_depth_used", report.depth_prior);
  add("known_pose_used", report.pose_prior);
  json["earlier_resets"] = io::Json::array();
  for (const InitReason reason : report.earlier_resets) {
    json["earlier_resets"].push_back(name(reason));
  }
  io::Json& details = json["details"] = io::Json::object();
  for (const Detail& detail : report.details) details[detail.name] = detail.value;
  return json;
}

void noteRefusal(const std::optional<StartRefusal>& refusal, io::Json& initialization) {
  initialization["withdrawn"] = refusal.has_value();
  initialization["withdrawal"] = nullptr;
  if (!refusal) return;
  const StartChange& change = refusal->change;
  initialization["withdrawal"] = {{"reason", name(refusal->reason)},
                                  {"index", refusal->frame.value},
                                  {"direction_deg", change.direction_deg},
                                  {"depth_spread", change.depth_spread},
                                  {"depth_change", change.depth_change},
                                  {"kept_share", change.kept_share}};
}

}  // namespace

/// initialization.json: one object per successful initialization, added when it comes.
class InitializationWriter {
 public:
  /// Writes the empty list. @throws IoError where it cannot be written
  InitializationWriter(fs::path path, std::string initializer)
      : file_(std::move(path)), initializer_(std::move(initializer)) {
    file_.append(kHead, kTail);
  }

  void setCamera(const PinholeCamera& camera) { camera_ = camera; }

  /// Counts the current frame and writes when it brought an initialization.
  void update(const io::RunRecord& record, double milliseconds) {
    if (record.estimate()) {
      if (record.estimate()->segment != progress_.segment) {
        progress_ = {};
        progress_.segment = record.estimate()->segment;
      }
      ++progress_.frames_given;
    }
    for (const io::InitStepNote& step : record.steps()) {
      if (step.status == InitStatus::kRestarted && step.reason != InitReason::kFirstFrame) {
        ++progress_.resets;
        progress_.attempt_milliseconds = 0;
      }
    }
    if (!record.steps().empty()) {
      progress_.total_milliseconds += milliseconds;
      progress_.attempt_milliseconds += milliseconds;
    }
    for (const io::InitStepNote& step : record.steps()) {
      if (!step.result) continue;
      const std::string text = io::jsonText(describe(step, milliseconds), kDepth);
      file_.append(fmt::format("{}\n  {}", separator_, text), fmt::format("\n {}", kTail));
      separator_ = ",";
    }
  }

 private:
  /// The start of a segment up to now.
  struct Progress {
    int segment = -1;
    int frames_given = 0;
    int resets = 0;
    double total_milliseconds = 0;
    double attempt_milliseconds = 0;  ///< since the last reset
  };

  [[nodiscard]] io::Json describe(const io::InitStepNote& step, double milliseconds) const {
    const InitializationResult& result = *step.result;
    const Frame& reference = *result.frames.front().frame;
    const Frame& target = *result.frames.back().frame;
    io::Json json;
    json["initializer"] = initializer_;
    json["segment"] = progress_.segment;
    json["frames_given"] = progress_.frames_given;
    json["frames_since_reference"] = std::abs(target.id().value - reference.id().value);
    json["resets"] = progress_.resets;
    noteRefusal(step.refusal, json);
    json["reference"] = frameReference(reference);
    json["target"] = frameReference(target);
    json["camera"] = io::cameraJson(camera_);
    json["poses"] = poses(result);
    json["points"] = referencePoints(result);
    io::Json stages = io::Json::object();
    for (const StageTime& stage : result.report.stages) stages[stage.stage] = stage.milliseconds;
    json["milliseconds"] = {{"total", progress_.total_milliseconds},
                            {"this_attempt", progress_.attempt_milliseconds},
                            {"last_frame", milliseconds},
                            {"stages", std::move(stages)}};
    if (result.metric) {
      json["metric"] = {{"metres_per_unit", result.metric->metres},
                        {"relative_sigma", result.metric->relative_sigma}};
    }
    json["report"] = reportJson(result);
    return json;
  }

  io::GrowingFile file_;
  std::string initializer_;
  PinholeCamera camera_;
  Progress progress_;
  const char* separator_ = "";
};

namespace {

/// What run.json says until finish(): the run was killed.
std::string firstSummary(const RunInfo& info) {
  return io::jsonText(io::runJson(info, {}, io::RunRecord({}), {}));
}

/// Keyframes from which on run.json and points.ply are brought up to date again: each a tenth after
/// the one before.
std::size_t nextWriting(std::size_t keyframes) {
  return keyframes + std::max<std::size_t>(1, keyframes / 10);
}

}  // namespace

class RunWriter::Impl {
 public:
  Impl(const std::string& folder_name, const RunInfo& run_info)
      : folder(folder_name),
        prepared(folder, run_info.program, firstSummary(run_info)),
        info(run_info),
        record(folder),
        frames_csv(folder / "frames.csv"),
        trajectory(folder, "trajectory"),
        keyframes(folder, "keyframes"),
        initializations(folder / "initialization.json", run_info.initializer),
        points(folder) {
    frames_csv.append(io::frameTableHeader());
    io::replaceFile(folder / "config.yaml", info.config_yaml);
  }

  void writeFrame(const FrameTiming& timing, const std::string& image_file) {
    frames_csv.append(io::frameTableLine(*record.estimate(), timing.work_milliseconds, image_file));
    trajectory.update(record, record.frames());
    keyframes.update(record, record.keyframes());
    initializations.update(record, timing.work_milliseconds);
    writeInitialFigures();
    const std::size_t count = record.keyframes().size();
    if (!keyframes_changed || (count < next_writing && !points.isFull())) return;
    points.update();
    next_writing = nextWriting(count);
    writeRunJson(RunStatus::kError, nullptr);
    keyframes_changed = false;
  }

  /// All but run.json, once the run has ended.
  void writeFinalFiles(RunStatus outcome) {
    trajectory.finish(record, record.frames());
    keyframes.finish(record, record.keyframes());
    if (record.facts().segments.size() == 1 && outcome == RunStatus::kTracked) {
      io::writeKitti(folder / "trajectory_kitti.txt", record, record.frames());
    }
    points.finish(record.changes());
    io::writePng(folder / "figures" / "trajectory.png", io::drawTrajectory(record));
    io::writePng(folder / "figures" / "timeline.png", io::drawTimeline(record));
    writeCalibration();
  }

  void writeInitialFigures() const {
    for (const io::InitStepNote& step : record.steps()) {
      if (!step.result || step.refusal) continue;
      const std::string suffix = step.segment == 0 ? "" : fmt::format("_{}", step.segment);
      io::writePng(folder / "figures" / ("initial_inverse_depth" + suffix + ".png"),
                   io::drawInverseDepth(*step.result));
    }
  }

  /// Calibration that the run refined; empty where it is not settled, or of no form of ours.
  [[nodiscard]] std::string refinedCalibration() const {
    if (!cameras.camera || !cameras.lens || !cameras.areSettled()) return {};
    Lens lens = *cameras.lens;
    if (cameras.readout) lens.readout = *cameras.readout;
    return cameras.refined.calibrationFile(lens, *cameras.camera);
  }

  /// Writes the calibration for the next run: the one that was refined, or else the one that was
  /// found before.
  void writeCalibration() const {
    std::string file = refinedCalibration();
    if (file.empty() && cameras.found && cameras.found->isKnown()) {
      file = io::calibrationFile(cameras.found->lens);
    }
    if (!file.empty()) io::replaceFile(folder / "refined_camera.txt", file);
  }

  void writeRunJson(RunStatus status, const OdometryReport* report) const {
    io::RunSeconds written = seconds;
    written.total = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (report != nullptr) {
      written.initializing = report->initializing_seconds;
      written.tracking = report->tracking_seconds;
      written.mapping = report->mapping_seconds;
    }
    const io::Json json =
        io::runJson(info, cameras, record, {status, frames_dropped, unreadable, written});
    io::replaceFile(folder / "run.json", io::jsonText(json));
  }

  fs::path folder;
  io::OutputFolder prepared;  // before any member opens a file there
  RunInfo info;
  io::RunCameras cameras;
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  io::RunSeconds seconds;
  io::RunRecord record;
  io::GrowingFile frames_csv;
  io::TrajectoryWriter trajectory;
  io::TrajectoryWriter keyframes;
  InitializationWriter initializations;
  io::PointsPly points;
  bool keyframes_changed = false;
  std::size_t next_writing = 0;  // number of keyframes
  int frames_dropped = 0;
  std::vector<std::string> unreadable;
};

RunWriter::RunWriter(const std::string& folder, const RunInfo& info)
    : impl_(std::make_unique<Impl>(folder, info)) {}
RunWriter::~RunWriter() = default;

void RunWriter::setCamera(const PinholeCamera& camera, const Lens* lens) {
  impl_->cameras.camera = camera;
  if (lens != nullptr) impl_->cameras.lens = *lens;
  impl_->initializations.setCamera(camera);
}

void RunWriter::setFoundCamera(const FoundCamera& camera) {
  impl_->cameras.found = camera;
}

void RunWriter::setConfig(const std::string& yaml) {
  io::replaceFile(impl_->folder / "config.yaml", yaml);
}

void RunWriter::onInitStep(const InitStep& step, const Frame& /*frame*/, int segment) {
  impl_->record.addInitStep(step, segment);
}

void RunWriter::onStartRefused(const StartRefusal& refusal) {
  impl_->record.addRefusal(refusal);
}

void RunWriter::onSegmentsJoined(const SegmentsJoined& joined) {
  impl_->record.addJoin(joined);
}

void RunWriter::onLoopsClosed(const LoopsClosed& closed) {
  impl_->record.addLoops(closed);
}

void RunWriter::onTracks(const std::vector<MapTrack>& tracks) {
  io::writeTracks(impl_->folder / "tracks.ply", tracks);
}

void RunWriter::onFrame(const FrameEstimate& estimate) {
  impl_->record.addFrame(estimate);
}

void RunWriter::onKeyframe(const KeyframeSnapshot& keyframe) {
  impl_->record.addKeyframe(keyframe);
  impl_->points.setKeyframe(keyframe);
  impl_->cameras.refined.add(keyframe);
  if (keyframe.readout) impl_->cameras.readout = keyframe.readout;
  impl_->keyframes_changed = true;
}

void RunWriter::onKeyframeRetired(const KeyframeSnapshot& keyframe) {
  impl_->record.addKeyframe(keyframe);
  impl_->points.retireKeyframe(keyframe);
  impl_->keyframes_changed = true;
}

void RunWriter::frameDone(const FrameTiming& timing, const std::string& image_file) {
  Impl& run = *impl_;
  run.seconds.reading += timing.reading_milliseconds * 1e-3;
  if (!run.record.estimate()) return;
  const OdometryState state = run.record.estimate()->state;
  const bool initializing =
      state == OdometryState::kInitializing || state == OdometryState::kInitialized;
  (initializing ? run.seconds.initializing : run.seconds.tracking) +=
      timing.work_milliseconds * 1e-3;
  run.record.setMilliseconds(timing.work_milliseconds);

  timed(run.seconds.writing, [&] { run.writeFrame(timing, image_file); });
  run.record.nextFrame();
}

void RunWriter::setDropped(int frames) {
  impl_->frames_dropped = frames;
}

void RunWriter::setUnreadable(std::vector<std::string> files) {
  impl_->unreadable = std::move(files);
}

RunStatus RunWriter::outcome() const {
  const io::RunRecord& record = impl_->record;
  if (record.facts().segments.empty()) return RunStatus::kNeverInitialized;
  const OdometryState last = record.notes().newest().state;
  const bool map_stands = last != OdometryState::kInitializing && last != OdometryState::kLost;
  if (!map_stands) return RunStatus::kLost;
  const bool most = 2 * record.frames().size() >= record.notes().size();
  return most ? RunStatus::kTracked : RunStatus::kPartlyTracked;
}

bool RunWriter::calibrationSuspected() const {
  return impl_->record.facts().contradicted_camera.has_value();
}

void RunWriter::finish(RunStatus status, const OdometryReport* report) {
  Impl& run = *impl_;
  timed(run.seconds.writing, [&] { run.writeFinalFiles(outcome()); });
  run.writeRunJson(status, report);
}

void RunWriter::writeKeyframes(const std::string& path) const {
  const io::RunRecord& record = impl_->record;
  io::writeTum(path, record, record.keyframes(), record.longestSegment());
}

}  // namespace dsorb
