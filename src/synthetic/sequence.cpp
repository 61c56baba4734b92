// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/sequence.h"

#include "base/parallel.h"
#include "base/random.h"
#include "synthetic/places.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::synthetic {
namespace {

constexpr double kCameraHeight = 1.65;  // as KITTI's cameras [m]

/// Start phase of a path [rad].
double startPhase(std::uint64_t seed) {
  return 2 * M_PI * Random(seed ^ 0x7A7AULL).uniform();
}

/// Camera axes (x right, y down, z ahead) turned by heading, then pitch, then roll [rad].
Eigen::Quaterniond orientation(double heading, double pitch, double roll) {
  return so3Exp({0, heading, 0}) * so3Exp({pitch, 0, 0}) * so3Exp({0, 0, roll});
}

/// Sum of two incommensurable sines, within [-1, 1]: no two seconds of a path are alike.
double wave(double phase) {
  return 0.7 * std::sin(phase) + 0.3 * std::sin(2.63 * phase + 1.0);
}

double streetPosition(double frame, double phase) {
  return kStreetStep * frame + 0.5 * std::sin(0.25 * frame + phase);
}

// The inverse response of the simulated camera is a x + (1 - a) x^2 for x in [0, 1]: smooth,
// strictly increasing and exactly invertible, about as bent as the curves of real cameras.
constexpr double kLinearPart = 0.35;
// Brightness left in the corners: 1 - kVignetteSquare - kVignetteFourth.
constexpr double kVignetteSquare = 0.28;
constexpr double kVignetteFourth = 0.12;
constexpr std::size_t kTableSize = 4096;  // the forward response, for speed
constexpr std::size_t kRowsPerTask = 16;

constexpr double kStreetFocal = 0.58;       // focal length over width, as KITTI 00
constexpr double kRoomFocal = 0.625;        // between EuRoC and TUM RGB-D
constexpr double kStreetRate = 10;          // [frames/s]
constexpr double kRoomRate = 30;            // [frames/s]
constexpr double kNominalExposure = 0.01;   // [s]
constexpr double kExposurePeriod = 37;      // of the exposure's swing [frames]
constexpr int kBlurSamples = 7;             // views averaged over the open shutter
constexpr double kPlaceDistance = 100;      // between the places of a cut [m]
constexpr std::uint64_t kNextPlace = 1001;  // added to the seed after a cut
const Eigen::Vector3d kVan(2.2, 2.4, 4.5);  // [m], across, up, along
constexpr int kSmallest = 32;               // image side [px]
constexpr double kSlowest = 0.01;           // speed
constexpr double kFastest = 100;
constexpr double kFastestRate = 1000;  // [frames/s]

[[noreturn]] void reject(const std::string& what, double value) {
  throw std::invalid_argument("SequenceOptions: " + what + ", is " + std::to_string(value));
}

bool isDrive(SequenceKind kind) {
  return kind == SequenceKind::kStreet || kind == SequenceKind::kBlock;
}

double usualRate(SequenceKind kind) {
  return isDrive(kind) ? kStreetRate : kRoomRate;
}

double frameRate(const SequenceOptions& options) {
  return options.rate > 0 ? options.rate : usualRate(options.kind);
}

/// Paths are functions of the frames that a usual camera would have taken.
double usualFrames(const SequenceOptions& options) {
  return options.speed * (usualRate(options.kind) / frameRate(options));
}

void validate(const SequenceOptions& options) {
  const auto inside = [](double value, double low, double high) {
    return value >= low && value <= high;
  };
  if (options.width < kSmallest) reject("width must be at least 32 px", options.width);
  if (options.height < kSmallest) reject("height must be at least 32 px", options.height);
  if (!inside(options.fx, 0, 1e6)) reject("fx must lie in [0, 1e6] px", options.fx);
  if (options.length < 1) reject("length must be at least 1 frame", options.length);
  if (!inside(options.noise_sigma, 0, 100)) {
    reject("noise_sigma must lie in [0, 100] grey levels", options.noise_sigma);
  }
  if (!inside(options.light, 0, 10)) reject("light must lie in [0, 10]", options.light);
  if (!inside(options.exposure_changes, 0, 2)) {
    reject("exposure_changes must lie in [0, 2]", options.exposure_changes);
  }
  if (!inside(options.moving_object_share, 0, 0.5)) {
    reject("moving_object_share must lie in [0, 0.5]", options.moving_object_share);
  }
  if (!inside(options.motion_blur, 0, 1)) {
    reject("motion_blur must lie in [0, 1]", options.motion_blur);
  }
  if (!inside(options.rate, 0, kFastestRate)) reject("rate must lie in [0, 1000]", options.rate);
  if (!inside(std::abs(options.readout), 0, 1 / frameRate(options))) {
    reject("readout must be at most the time between two frames, in seconds", options.readout);
  }
  if (!inside(options.speed, kSlowest, kFastest)) {
    reject("speed must lie in [0.01, 100]", options.speed);
  }
  if (!inside(options.camera_speed, 0, kFastest)) {
    reject("camera_speed must lie in [0, 100]", options.camera_speed);
  }
}

Scene makePlace(const SequenceOptions& options, std::uint64_t seed) {
  switch (options.kind) {
    case SequenceKind::kStreet:
      return makeStreet(seed,
                        kStreetStep * options.length * usualFrames(options) *
                            std::max(1.0, options.camera_speed));
    case SequenceKind::kPlane:
      return makePlane(seed);
    case SequenceKind::kBlock:
      return makeBlock(seed);
    default:
      return makeRoom(seed);
  }
}

}  // namespace

namespace {

SE3 drivePose(double frame, std::uint64_t seed, StreetAxis (*axisAt)(double along)) {
  const double phase = startPhase(seed);
  const StreetAxis axis = axisAt(streetPosition(frame, phase));
  const double sway = 0.25 * std::sin(0.05 * frame + phase);
  const double sway_heading = 0.25 * 0.05 / kStreetStep * std::cos(0.05 * frame + phase);
  const double pitch = 0.005 * wave(0.9 * frame + phase);
  const double roll = 0.004 * wave(0.5 * frame + 2 * phase);
  const double bounce = 0.015 * wave(0.8 * frame + 3 * phase);
  return {orientation(axis.heading + sway_heading, pitch, roll),
          Eigen::Vector3d(axis.x + sway, -kCameraHeight + bounce, axis.z)};
}

}  // namespace

SE3 streetPose(double frame, std::uint64_t seed) {
  return drivePose(frame, seed, streetAxis);
}

SE3 blockPose(double frame, std::uint64_t seed) {
  return drivePose(frame, seed, blockAxis);
}

SE3 roundPose(double frame, std::uint64_t seed) {
  const double phase = startPhase(seed);
  const double turn = 0.024 * frame + phase;
  const Eigen::Vector3d position(
      0.8 * std::sin(turn), -1.35 + 0.18 * wave(1.7 * turn), 0.1 + 0.8 * std::cos(turn));
  const double heading = turn + 0.16 * wave(0.031 * frame + phase);
  const double pitch = -0.16 + 0.07 * wave(0.043 * frame + 2 * phase);
  return {orientation(heading, pitch, 0.05 * wave(0.037 * frame + 3 * phase)), position};
}

SE3 roomPose(double frame, std::uint64_t seed) {
  const double phase = startPhase(seed);
  const double turn = 0.024 * frame + phase;  // one loop takes about nine seconds
  const Eigen::Vector3d position(
      1.1 * std::sin(turn), -1.35 + 0.18 * wave(1.7 * turn), -0.9 + 0.7 * std::cos(turn));
  const double heading = -0.18 * std::sin(turn) + 0.16 * wave(0.031 * frame + phase);
  const double pitch = -0.16 + 0.07 * wave(0.043 * frame + 2 * phase);
  const double roll = 0.05 * wave(0.037 * frame + 3 * phase);
  return {orientation(heading, pitch, roll), position};
}

SE3 planePose(double frame, std::uint64_t seed) {
  const double phase = startPhase(seed);
  const Eigen::Vector3d position(1.5 * std::sin(0.025 * frame + phase),
                                 0.8 * std::sin(0.031 * frame + 2 * phase),
                                 0.6 * std::sin(0.028 * frame + 3 * phase));
  return {orientation(0.12 * wave(0.026 * frame + phase),
                      0.10 * wave(0.03 * frame + 2 * phase),
                      0.15 * wave(0.02 * frame + 3 * phase)),
          position};
}

SE3 rotationPose(double frame, std::uint64_t seed) {
  SE3 pose = roomPose(0, seed);
  const double turn = 0.05 * frame;
  const Eigen::Quaterniond rotation =
      orientation(0.45 * std::sin(turn), 0.12 * std::sin(1.7 * turn), 0.10 * std::sin(1.3 * turn));
  return {pose.unitQuaternion() * rotation, pose.translation()};
}

SE3 movingCarPose(double frame, std::uint64_t seed) {
  // Starts ahead and drives a little slower: it comes nearer by 6 cm per frame.
  const double z = 13 + 0.95 * streetPosition(frame, startPhase(seed));
  const StreetAxis axis = streetAxis(z);
  return {so3Exp({0, axis.heading, 0}), Eigen::Vector3d(axis.x + 0.4, -0.95, z)};
}

SE3 movingVanPose(double frame, std::uint64_t seed, double ahead, double height) {
  const double z = ahead + streetPosition(frame, startPhase(seed));
  const StreetAxis axis = streetAxis(z);
  const double swerve = 1.2 * std::sin(0.13 * frame);  // at most 16 cm per frame
  return {so3Exp({0, axis.heading, 0}), Eigen::Vector3d(axis.x + swerve, -height, z)};
}

SE3 movingCratePose(double frame, std::uint64_t seed) {
  const double phase = 0.04 * frame + startPhase(seed);
  return {so3Exp({0, 0.5 * phase, 0}),
          Eigen::Vector3d(1.2 * std::sin(phase), -1.1 + 0.2 * std::cos(phase), 1.2)};
}

double forwardResponse(double irradiance, bool nonlinear) {
  const double y = std::clamp(irradiance / 255.0, 0.0, 1.0);
  if (!nonlinear) return 255.0 * y;
  const double curved = 1.0 - kLinearPart;
  return 255.0 * (std::sqrt(kLinearPart * kLinearPart + 4 * curved * y) - kLinearPart) /
         (2 * curved);
}

std::vector<double> makeInverseResponse(bool nonlinear) {
  std::vector<double> inverse(256);
  for (std::size_t value = 0; value < inverse.size(); ++value) {
    const double x = static_cast<double>(value) / 255.0;
    inverse[value] = 255.0 * (nonlinear ? kLinearPart * x + (1 - kLinearPart) * x * x : x);
  }
  return inverse;
}

std::vector<float> makeVignette(int width, int height, bool enabled) {
  std::vector<float> vignette(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                              1.0F);
  if (!enabled) return vignette;
  const double middle_x = 0.5 * (width - 1);
  const double middle_y = 0.5 * (height - 1);
  const double corner = middle_x * middle_x + middle_y * middle_y;
  float* pixel = vignette.data();
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double square =
          ((x - middle_x) * (x - middle_x) + (y - middle_y) * (y - middle_y)) / corner;
      *pixel++ =
          static_cast<float>(1 - kVignetteSquare * square - kVignetteFourth * square * square);
    }
  }
  return vignette;
}

std::vector<std::uint8_t> expose(const std::vector<float>& irradiance,
                                 const std::vector<float>& vignette,
                                 int width,
                                 const Exposure& exposure) {
  std::array<float, kTableSize + 2> response{};
  const float per_grey = static_cast<float>(kTableSize) / 255.0F;
  for (std::size_t i = 0; i < response.size(); ++i) {
    response[i] = static_cast<float>(forwardResponse(
        static_cast<double>(i) / static_cast<double>(per_grey), exposure.nonlinear));
  }
  const auto columns = static_cast<std::size_t>(width);
  const auto gain = static_cast<float>(exposure.gain);
  std::vector<std::uint8_t> image(irradiance.size());
  forEachRange(irradiance.size() / columns, kRowsPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      Random random(exposure.seed + 0x9E3779B97F4A7C15ULL * (row + 1));
      Random noise(random.next());
      for (std::size_t i = row * columns; i < (row + 1) * columns; ++i) {
        const float light = std::clamp(gain * irradiance[i] * vignette[i], 0.0F, 255.0F) * per_grey;
        const auto cell = static_cast<std::size_t>(light);
        const float part = light - static_cast<float>(cell);
        double value = response[cell] + part * (response[cell + 1] - response[cell]);
        if (exposure.noise_sigma > 0) value += exposure.noise_sigma * noise.gaussian();
        image[i] = static_cast<std::uint8_t>(std::clamp(value + 0.5, 0.0, 255.0));
      }
    }
  });
  return image;
}

SyntheticSequence::SyntheticSequence(const SequenceOptions& options) : options_(options) {
  validate(options);
  const bool street = isDrive(options.kind);
  const double fx =
      options.fx > 0 ? options.fx : (street ? kStreetFocal : kRoomFocal) * options.width;
  camera_ = {
      fx, fx, 0.5 * (options.width - 1), 0.5 * (options.height - 1), options.width, options.height};
  acts_.push_back(makePlace(options, options.seed));
  if (options.kind == SequenceKind::kCut) {
    acts_.push_back(makePlace(options, options.seed + kNextPlace));
    for (Box& box : acts_.back().boxes) {
      box.T_world_box.setTranslation(box.T_world_box.translation() +
                                     Eigen::Vector3d(kPlaceDistance, 0, 0));
    }
  }
  if (options.moving_object) {
    const bool close = street && options.moving_object_share > 0;
    const Eigen::Vector3d size = close    ? kVan
                                 : street ? Eigen::Vector3d(1.8, 1.5, 4.0)
                                          : Eigen::Vector3d(0.6, 0.5, 0.5);
    moving_box_ = addMovingBox(acts_.front(), options.seed, size, close);
    if (acts_.size() > 1) addMovingBox(acts_.back(), options.seed + kNextPlace, size);
    if (options.moving_object_plain) {
      for (Scene& act : acts_) {
        Texture& paint = act.textures[static_cast<std::size_t>(act.boxes.back().texture)];
        paint.tiles.clear();
        paint.noise.clear();
      }
    }
  }
  inverse_response_ = makeInverseResponse(options.nonlinear_response);
  vignette_ = makeVignette(options.width, options.height, options.vignette);
}

int SyntheticSequence::actOf(int index) const {
  if (index < 0 || index >= options_.length) {
    throw std::out_of_range("SyntheticSequence: frame " + std::to_string(index) + " of " +
                            std::to_string(options_.length));
  }
  return acts_.size() > 1 && index >= options_.length / 2 ? 1 : 0;
}

SE3 SyntheticSequence::poseAt(int act, double frame) const {
  frame *= usualFrames(options_);
  const std::uint64_t seed = options_.seed + (act > 0 ? kNextPlace : 0);
  switch (options_.kind) {
    case SequenceKind::kStreet:
      return streetPose(frame * options_.camera_speed, seed);
    case SequenceKind::kPlane:
      return planePose(frame, seed);
    case SequenceKind::kBlock:
      return blockPose(frame * options_.camera_speed, seed);
    case SequenceKind::kRound:
      return roundPose(frame, seed);
    case SequenceKind::kStatic:
      return roomPose(0, seed);
    case SequenceKind::kRotation:
      return rotationPose(frame, seed);
    default:
      return uprightPose({act * kPlaceDistance, 0, 0}) * roomPose(frame, seed);
  }
}

SE3 SyntheticSequence::movingBoxPose(int act, double frame) const {
  frame *= usualFrames(options_);
  if (options_.kind != SequenceKind::kStreet) {
    return uprightPose({act * kPlaceDistance, 0, 0}) * movingCratePose(frame, options_.seed);
  }
  if (!(options_.moving_object_share > 0)) return movingCarPose(frame, options_.seed);
  const double pixels =
      options_.moving_object_share * options_.width * static_cast<double>(options_.height);
  const double rear = camera_.fx * std::sqrt(kVan.x() * kVan.y() / pixels);  // pinhole, seen square
  return movingVanPose(frame, options_.seed, rear + 0.5 * kVan.z(), 0.5 * kVan.y());
}

Moment SyntheticSequence::momentAt(int act, double frame) const {
  Moment moment{poseAt(act, frame), {}};
  if (moving_box_ >= 0) moment.T_world_moving = movingBoxPose(act, frame);
  return moment;
}

View SyntheticSequence::renderAt(int act, double frame) const {
  std::vector<Moment> moments;
  const int rows = options_.readout != 0 ? camera_.height : 1;
  const double frames_per_row = rows > 1 ? options_.readout * frameRate(options_) / (rows - 1) : 0;
  moments.reserve(static_cast<std::size_t>(rows));
  for (int row = 0; row < rows; ++row) {
    moments.push_back(momentAt(act, frame + frames_per_row * (row - 0.5 * (rows - 1))));
  }
  return render(acts_[static_cast<std::size_t>(act)], camera_, moments, options_.rendering);
}

std::vector<float> SyntheticSequence::inverseDepthAt(int act, double frame) const {
  const Scene& scene = acts_[static_cast<std::size_t>(act)];
  return render(scene, camera_, {momentAt(act, frame)}, {1, 1}).inverse_depth;
}

std::vector<float> SyntheticSequence::blurredIntensity(int index, View& centre) const {
  std::vector<float> sum = std::move(centre.intensity);
  if (!(options_.motion_blur > 0)) return sum;
  for (int sample = 0; sample < kBlurSamples; ++sample) {
    if (2 * sample == kBlurSamples - 1) continue;  // the middle is there already
    const double offset = (sample + 0.5) / kBlurSamples - 0.5;
    const View view = renderAt(actOf(index), index + options_.motion_blur * offset);
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += view.intensity[i];
  }
  for (float& value : sum) value *= 1.0F / kBlurSamples;
  return sum;
}

SE3 SyntheticSequence::pose(int index) const {
  return poseAt(actOf(index), index);
}

double SyntheticSequence::timestamp(int index) const {
  return index / frameRate(options_);
}

double SyntheticSequence::exposure(int index) const {
  const double swing = std::sin(2 * M_PI * index / kExposurePeriod);
  return kNominalExposure * std::exp(options_.exposure_changes * swing);
}

SyntheticFrame SyntheticSequence::frame(int index) const {
  View view = renderAt(actOf(index), index);
  SyntheticFrame frame;
  frame.width = view.width;
  frame.height = view.height;
  frame.inverse_depth = options_.readout != 0 ? inverseDepth(index) : std::move(view.inverse_depth);
  frame.T_world_cam = pose(index);
  frame.timestamp = timestamp(index);
  frame.exposure = exposure(index);
  for (const std::int32_t surface : view.surface) {
    frame.moving_object_visible |= moving_box_ >= 0 && surface / 8 == moving_box_;
  }
  // The longest exposure just does not saturate.
  const double longest = kNominalExposure * std::exp(options_.exposure_changes);
  const Exposure settings{options_.light * frame.exposure / longest,
                          options_.nonlinear_response,
                          options_.noise_sigma,
                          (options_.seed << 32U) + static_cast<std::uint64_t>(index)};
  frame.image = expose(blurredIntensity(index, view), vignette_, view.width, settings);
  return frame;
}

std::vector<float> SyntheticSequence::inverseDepth(int index) const {
  return inverseDepthAt(actOf(index), index);
}

FramePtr SyntheticSequence::framePtr(int index) const {
  return framePtr(frame(index), index);
}

FramePtr SyntheticSequence::framePtr(const SyntheticFrame& frame, int index) const {
  FrameInfo info;
  info.id = FrameId{index};
  info.timestamp = frame.timestamp;
  info.exposure = frame.exposure;
  if (!isPhotometric()) return Frame::create(frame.view(), info);
  std::vector<float> corrected(frame.image.size());
  for (std::size_t i = 0; i < corrected.size(); ++i) {
    corrected[i] = static_cast<float>(inverse_response_[frame.image[i]]) / vignette_[i];
  }
  return Frame::create(ImageView(corrected.data(), frame.width, frame.height), info);
}

bool SyntheticSequence::isPhotometric() const {
  return options_.nonlinear_response || options_.vignette || options_.exposure_changes > 0;
}

bool SyntheticSequence::hasParallax() const {
  return options_.kind != SequenceKind::kStatic && options_.kind != SequenceKind::kRotation;
}

}  // namespace dsorb::synthetic
