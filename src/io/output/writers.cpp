// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/writers.h"

#include "dsorb/camera/pinhole_camera.h"

#include "base/timed.h"
#include "camera/lens_models.h"
#include "io/output/figures.h"
#include "io/output/output_file.h"
#include "io/output/run_record.h"
#include "io/text_file.h"
#include "platform/process.h"
#include "self_calibration/refined_camera.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb {

namespace fs = std::filesystem;

const char* name(RunStatus status) {
  constexpr std::array<const char*, 6> kNames = {
      "tracked", "partly_tracked", "lost", "never_initialized", "interrupted", "error"};
  return kNames.at(static_cast<std::size_t>(status));
}

namespace io {

/// Outcome of a run as far as its record does not contain it.
struct RunEnd {
  RunStatus status = RunStatus::kError;
  int frames_dropped = 0;
  std::vector<std::string> unreadable;  // files that were passed over
  // Time that its stages took [s]; writing is that of all files but the last run.json.
  double total = 0;
  double reading = 0;
  double initializing = 0;
  double tracking = 0;
  double mapping = 0;
  double writing = 0;
};

/// The cameras of a run as far as they are known.
struct RunCameras {
  std::optional<PinholeCamera> camera;  // of the rectified images
  std::optional<Lens> lens;             // of the images as they were taken
  RefinedCamera refined;                // by the window
  std::optional<FoundCamera> found;     // by earlier passes, as `lens`
  std::optional<Readout> readout;       // estimated, of the newest keyframe

  /// Whether `refined` may be the next run's calibration. The window holds principal point,
  /// distortion and readout as they were found: where the images did not tell the focal length
  /// beside these, its own standard deviation is too small.
  [[nodiscard]] bool areSettled() const {
    return refined.isSettled() && (!found || found->isKnown());
  }
};

namespace {

/// Text as RFC 4180 has it: in quotes where it holds a comma, a quote or a line break.
std::string csvField(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string field = "\"";
  for (const char c : text) field += c == '"' ? std::string("\"\"") : std::string(1, c);
  return field + "\"";
}

std::string poseFields(const std::optional<SE3>& pose) {
  if (!pose || !isFinite(*pose)) return ",,,,,,,";
  return fmt::format(",{:.9f},{:.9f}",
                     fmt::join(pose->translation(), ","),
                     fmt::join(pose->unitQuaternion().coeffs(), ","));
}

std::string covarianceFields(const std::optional<Matrix6d>& covariance) {
  const bool known = covariance && covariance->allFinite();
  std::string fields;
  for (int i = 0; i < 36; ++i) {
    const int row = i / 6, column = i % 6;
    if (column < row) continue;
    fields += known ? fmt::format(",{:.6e}", (*covariance)(row, column)) : ",";
  }
  return fields;
}

/// First line of frames.csv.
std::string frameTableHeader() {
  std::string header =
      "index,timestamp,state,milliseconds,is_keyframe,tracking_rmse,segment,image,keyframe,rel_tx,"
      "rel_ty,rel_tz,rel_qx,rel_qy,rel_qz,rel_qw";
  for (const char* prefix : {"cov", "world_cov"}) {
    for (int i = 0; i < 36; ++i) {
      if (i / 6 <= i % 6) header += fmt::format(",{}_{}{}", prefix, i / 6, i % 6);
    }
  }
  return header + "\n";
}

/// Line of a frame; what does not exist or is not finite is an empty field.
std::string frameTableLine(const FrameEstimate& estimate,
                           double milliseconds,
                           const std::string& image_file) {
  const double rmse = estimate.tracking_rmse.value_or(-1);
  return fmt::format("{},{:.9f},{},{:.3f},{:d},{},{},{},{}{}{}{}\n",
                     estimate.frame->id().value,
                     estimate.frame->timestamp(),
                     name(estimate.state),
                     milliseconds,
                     estimate.is_keyframe,
                     std::isfinite(rmse) && rmse >= 0 ? fmt::format("{:.4f}", rmse) : "",
                     estimate.segment,
                     csvField(image_file),
                     estimate.keyframe ? fmt::to_string(estimate.keyframe->value) : "",
                     poseFields(estimate.T_cam_keyframe),
                     covarianceFields(estimate.covariance),
                     covarianceFields(estimate.world_covariance));
}

/// A pose as a row of KITTI's: the 3x4 matrix, row by row.
/// @source KITTI odometry benchmark, format of poses
std::string kittiLine(double /*timestamp*/, const SE3& T_world_cam) {
  const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T = T_world_cam.matrix().topRows<3>();
  return fmt::format("{:.9e}\n", fmt::join(T.data(), T.data() + T.size(), " "));
}

/// Replaces a file by the lines of a segment's entries, sorted by time.
void writePoses(const fs::path& path,
                const RunRecord& record,
                Entries entries,
                int segment,
                std::string (*line)(double, const SE3&) = tumLine) {
  std::stable_sort(entries.begin(), entries.end(), [](const PosedEntry& a, const PosedEntry& b) {
    return a.timestamp < b.timestamp;
  });
  std::string text;
  for (const PosedEntry& entry : entries) {
    if (record.segmentOf(entry) == segment)
      text += line(entry.timestamp, record.T_world_cam(entry));
  }
  replaceFile(path, text);
}

/// Appends the bytes of a plain value; processors that we know are little-endian.
template <typename Value>
void appendBytes(const Value& value, std::string& bytes) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

#pragma pack(push, 1)
/// A vertex of points.ply.
struct Vertex {
  std::array<float, 3> place;
  std::array<std::uint8_t, 3> colour;
  float variance;
  std::int32_t segment;
  std::int32_t keyframe;
};
#pragma pack(pop)

constexpr std::uintmax_t kVertexBytes = sizeof(Vertex);
constexpr std::size_t kBlockVertices = 4096;

std::array<float, 3> floatsOf(const Eigen::Vector3d& p) {
  const Eigen::Vector3f floats = p.cast<float>();
  return {floats.x(), floats.y(), floats.z()};
}

/// Vertices where joins and loops put them.
std::string changed(std::string_view vertices, const MapChanges& changes) {
  std::string bytes;
  for (std::size_t at = 0; at < vertices.size(); at += kVertexBytes) {
    Vertex vertex{};
    std::memcpy(&vertex, vertices.data() + at, kVertexBytes);
    const Similarity change = changes.changeOf(vertex.segment, FrameId{vertex.keyframe});
    const auto [x, y, z] = vertex.place;
    vertex.place = floatsOf(change * Eigen::Vector3d(x, y, z));
    const auto scale = static_cast<float>(change.scale);
    vertex.variance /= scale * scale;
    vertex.segment = changes.segmentOf(vertex.segment);
    appendBytes(vertex, bytes);
  }
  return bytes;
}

/// Vertices of all points that have a finite place in front of the camera.
std::string vertices(const KeyframeSnapshot& keyframe) {
  std::string bytes;
  for (const MapPoint& point : keyframe.points) {
    if (!(point.inverse_depth > 0) || !std::isfinite(point.variance)) continue;
    const Eigen::Vector3d p_cam = keyframe.camera.unproject(point.pixel.cast<double>()) /
                                  static_cast<double>(point.inverse_depth);
    const Eigen::Vector3d p_world = keyframe.T_world_cam * p_cam;
    if (!p_world.cast<float>().allFinite()) continue;
    const float grey = std::isfinite(point.intensity) ? point.intensity : 0.0F;
    const auto level = static_cast<std::uint8_t>(std::lround(std::clamp(grey, 0.0F, 255.0F)));
    appendBytes(Vertex{floatsOf(p_world),
                       {level, level, level},
                       point.variance,
                       keyframe.segment,
                       keyframe.id.value},
                bytes);
  }
  return bytes;
}

/// Head of points.ply; its length is the same for any count.
std::string header(std::uintmax_t count) {
  const std::string number = fmt::format("{}", count);
  return fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment unit of each segment: units in "
      "run.json{:{}}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float inverse_depth_variance\nproperty int segment\nproperty int "
      "keyframe\nend_header\n",
      "",
      20 - number.size(),
      number);
}

/// tracks.ply: corners that several keyframes see, as a binary little-endian PLY file with two
/// elements: `point` (x y z segment) and `observation` (point keyframe u v), the latter with the
/// position of the point in the former and of the keyframe's image in its sequence.
void writeTracks(const fs::path& path, const std::vector<MapTrack>& tracks) {
  struct Point {
    std::array<float, 3> place;
    std::int32_t segment;
  };
  struct Sight {
    std::int32_t point;
    std::int32_t keyframe;
    std::array<float, 2> pixel;
  };
  std::string points;
  std::string sights;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    appendBytes(Point{floatsOf(tracks[i].position), tracks[i].segment}, points);
    for (const TrackSight& sight : tracks[i].sights) {
      const auto row = static_cast<std::int32_t>(i);
      appendBytes(Sight{row, sight.keyframe.value, {sight.pixel.x(), sight.pixel.y()}}, sights);
    }
  }
  const std::string head = fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float "
      "y\n"
      "property float z\nproperty int segment\nelement observation {}\nproperty int point\n"
      "property int keyframe\nproperty float u\nproperty float v\nend_header\n",
      tracks.size(),
      sights.size() / sizeof(Sight));
  replaceFile(path, head + points + sights);
}

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

/// Calibration file of images as they were taken, as DSO's camera.txt.
/// @param lens a pinhole or kRadTan
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

/// Joins and loops, in their order.
void addChanges(const MapChanges& changes, Json& json) {
  for (const SegmentsJoined& joined : changes.joins) {
    const auto sigmas = joined.covariance.diagonal().cwiseSqrt().eval();
    json["joined"].push_back({{"segment", joined.segment},
                              {"into", joined.into},
                              {"scale", joined.S_into_segment.scale},
                              {"pose", poseJson(joined.S_into_segment.motion)},
                              {"sigmas", std::vector<double>(sigmas.begin(), sigmas.end())},
                              {"keyframes", joined.keyframes},
                              {"matches", joined.matches},
                              {"wrong_probability", joined.wrong_probability}});
  }
  for (const LoopsClosed& closed : changes.loops) {
    json["loops"].push_back({{"segment", closed.segment}, {"loops", closed.loops}});
  }
}

Json unitsJson(const RunFacts& facts) {
  Json units = Json::array();
  for (const auto& [segment, metric] : facts.segments) {
    Json& unit =
        units.emplace_back(Json{{"segment", segment}, {"unit", metric ? "metre" : "free"}});
    if (metric) unit["relative_sigma"] = metric->relative_sigma;
  }
  return units;
}

/// Content of run.json.
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
  json["units"] = unitsJson(facts);
  addChanges(record.changes(), json);
  json["refused"] = Json::object();
  for (const RefusalReason reason :
       {RefusalReason::kAdjustment, RefusalReason::kDirection, RefusalReason::kDepth}) {
    json["refused"][name(reason)] =
        facts.refusals.count(reason) > 0 ? facts.refusals.at(reason) : 0;
  }
  json["answers"] = Json::object();
  for (const auto& [reason, count] : facts.answers) json["answers"][name(reason)] = count;
  json["status"] = name(end.status);
  json["seconds"] = {{"total", end.total},
                     {"reading", end.reading},
                     {"initializing", end.initializing},
                     {"tracking", end.tracking},
                     {"mapping", end.mapping},
                     {"writing", end.writing}};
  json["peak_memory_mb"] = platform::peakMemory();
  json["threads"] = info.threads;
  return json;
}

}  // namespace

/// trajectory.txt or keyframes.txt: grows with the estimates of the moment, ends as the final poses
/// sorted by time. A file holds one segment: while the run goes on the first one, those after it
/// in trajectory_<number>.txt; at the end the longest one, and where there are several each of them
/// also under its number.
class TrajectoryWriter {
 public:
  /// @param stem "trajectory" or "keyframes"
  TrajectoryWriter(fs::path folder, std::string stem)
      : folder_(std::move(folder)), stem_(std::move(stem)), file_(path("")) {}

  /// Appends the entries that are new. @throws IoError
  void update(const RunRecord& record, const Entries& entries) {
    for (; written_ < entries.size(); ++written_) {
      const PosedEntry& entry = entries[written_];
      if (entry.segment != segment_.value_or(entry.segment)) {
        file_ = GrowingFile(numbered(entry.segment));
      }
      segment_ = entry.segment;
      file_.append(tumLine(entry.timestamp, record.T_world_cam(entry)));
    }
  }

  void finish(const RunRecord& record, const Entries& entries) const {
    writePoses(path(""), record, entries, record.longestSegment());
    if (record.facts().segments.size() > 1) {
      for (const auto& [segment, unit] : record.facts().segments) {
        writePoses(numbered(segment), record, entries, segment);
      }
    }
    std::error_code error;  // files of segments that are part of another one now
    for (const SegmentsJoined& joined : record.changes().joins) {
      fs::remove(numbered(joined.segment), error);
    }
  }

 private:
  [[nodiscard]] fs::path path(const std::string& suffix) const {
    return folder_ / (stem_ + suffix + ".txt");
  }
  [[nodiscard]] fs::path numbered(int segment) const { return path(fmt::format("_{}", segment)); }

  fs::path folder_;
  std::string stem_;
  GrowingFile file_;
  std::optional<int> segment_;  // that the file holds
  std::size_t written_ = 0;
};

/// points.ply: the map as binary little-endian vertices `x y z red green blue
/// inverse_depth_variance segment keyframe`, in world coordinates of each segment; the last is the
/// position of the host's image. Points come when their keyframe is retired.
class PointsPly {
 public:
  explicit PointsPly(const fs::path& folder) : file_(folder / "points.ply") {
    file_.append(header(0));
  }

  void retireKeyframe(const KeyframeSnapshot& keyframe) { waiting_ += vertices(keyframe); }

  /// Brings the file up to date.
  void update() {
    file_.append(waiting_);
    bytes_ += waiting_.size();
    waiting_.clear();
    file_.write(0, header(bytes_ / kVertexBytes));
  }

  /// The same for the last time: points are where joins and loops put them.
  void finish(const MapChanges& changes) {
    update();
    const std::size_t begin = header(0).size();
    for (std::uintmax_t done = 0; done < bytes_ && !changes.empty();) {
      const auto size = std::min<std::uintmax_t>(bytes_ - done, kBlockVertices * kVertexBytes);
      const std::string told = file_.read(begin + done, static_cast<std::size_t>(size));
      file_.write(begin + done, changed(told, changes));
      done += size;
    }
  }

 private:
  GrowingFile file_;
  std::string waiting_;       // since the last update
  std::uintmax_t bytes_ = 0;  // of the vertices in the file
};

}  // namespace io

namespace {

constexpr const char* kStarts = "initializations";

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
  initialization["refused"] = refusal.has_value();
  initialization["refusal"] = nullptr;
  if (!refusal) return;
  const StartChange& change = refusal->change;
  initialization["refusal"] = {{"reason", name(refusal->reason)},
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
    file_.append(end_);
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
      append(io::jsonText({{kStarts, io::Json::array({describe(step, milliseconds)})}}));
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

  /// Puts the only start of a document behind those of the file.
  void append(const std::string& alone) {
    constexpr std::string_view kTail = "\n ]\n}\n";
    const bool is_first = end_ != kTail;
    file_.replaceEnd(end_, is_first ? alone : "," + alone.substr(alone.find('[') + 1));
    end_ = kTail;
  }

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
  std::string end_ = io::jsonText({{kStarts, io::Json::array()}});  // that the next start replaces
  std::string initializer_;
  PinholeCamera camera_;
  Progress progress_;
};

class RunWriter::Impl {
 public:
  Impl(const std::string& folder_name, const RunInfo& run_info)
      : folder(folder_name),
        // Until finish() the summary says that the run was killed.
        prepared(
            folder, run_info.program, io::jsonText(io::runJson(run_info, {}, io::RunRecord(), {}))),
        info(run_info),
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
    if (!keyframes_changed) return;
    points.update();
    writeRunJson(RunStatus::kError, nullptr);
    keyframes_changed = false;
  }

  /// All but run.json, once the run has ended.
  void writeFinalFiles(RunStatus outcome) {
    trajectory.finish(record, record.frames());
    keyframes.finish(record, record.keyframes());
    if (record.facts().segments.size() == 1 && outcome == RunStatus::kTracked) {
      io::writePoses(folder / "trajectory_kitti.txt",
                     record,
                     record.frames(),
                     record.longestSegment(),
                     io::kittiLine);
    }
    points.finish(record.changes());
    io::writePng(folder / "figures" / "trajectory.png", io::drawTrajectory(record));
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

  /// Writes the calibration for the next run: the one that was refined, where it is settled, or
  /// else the one that was found before.
  void writeCalibration() const {
    std::optional<Lens> lens;
    if (cameras.camera && cameras.lens && cameras.areSettled()) {
      lens = cameras.refined.lens(*cameras.lens, *cameras.camera);
      if (lens && cameras.readout) lens->readout = *cameras.readout;
    }
    if (!lens && cameras.found && cameras.found->isKnown()) lens = cameras.found->lens;
    if (lens) io::replaceFile(folder / "refined_camera.txt", io::calibrationFile(*lens));
  }

  void writeRunJson(RunStatus status, const OdometryReport* report) const {
    io::RunEnd now = end;
    now.status = status;
    now.total = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (report != nullptr) {
      now.initializing = report->initializing_seconds;
      now.tracking = report->tracking_seconds;
      now.mapping = report->mapping_seconds;
    }
    io::replaceFile(folder / "run.json", io::jsonText(io::runJson(info, cameras, record, now)));
  }

  fs::path folder;
  io::OutputFolder prepared;  // before any member opens a file there
  RunInfo info;
  io::RunCameras cameras;
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  io::RunEnd end;  // as far as it is known
  io::RunRecord record;
  io::GrowingFile frames_csv;
  io::TrajectoryWriter trajectory;
  io::TrajectoryWriter keyframes;
  InitializationWriter initializations;
  io::PointsPly points;
  bool keyframes_changed = false;
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
  run.end.reading += timing.reading_milliseconds * 1e-3;
  if (!run.record.estimate()) return;
  const OdometryState state = run.record.estimate()->state;
  const bool initializing =
      state == OdometryState::kInitializing || state == OdometryState::kInitialized;
  (initializing ? run.end.initializing : run.end.tracking) += timing.work_milliseconds * 1e-3;
  timed(run.end.writing, [&] { run.writeFrame(timing, image_file); });
  run.record.nextFrame();
}

void RunWriter::setDropped(int frames) {
  impl_->end.frames_dropped = frames;
}

void RunWriter::setUnreadable(std::vector<std::string> files) {
  impl_->end.unreadable = std::move(files);
}

RunStatus RunWriter::outcome() const {
  const io::RunRecord& record = impl_->record;
  if (record.facts().segments.empty()) return RunStatus::kNeverInitialized;
  const OdometryState last = record.facts().last_state;
  const bool map_stands = last != OdometryState::kInitializing && last != OdometryState::kLost;
  if (!map_stands) return RunStatus::kLost;
  const bool most =
      2 * record.frames().size() >= static_cast<std::size_t>(record.facts().frames_given);
  return most ? RunStatus::kTracked : RunStatus::kPartlyTracked;
}

bool RunWriter::calibrationSuspected() const {
  return impl_->record.facts().contradicted_camera.has_value();
}

void RunWriter::finish(RunStatus status, const OdometryReport* report) {
  Impl& run = *impl_;
  timed(run.end.writing, [&] { run.writeFinalFiles(outcome()); });
  run.writeRunJson(status, report);
}

void RunWriter::writeKeyframes(const std::string& path) const {
  const io::RunRecord& record = impl_->record;
  io::writePoses(path, record, record.keyframes(), record.longestSegment());
}

}  // namespace dsorb
