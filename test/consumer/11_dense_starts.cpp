// SPDX-License-Identifier: BSD-3-Clause
// The fork of fork/ started again and again:
//   11_dense_starts [SEQUENCE [EVERY [MIN_FRAMES [EARLY]]]]
// from every EVERY-th image (default: 10) of a data set with a groundtruth.txt (TUM format), or of
// the corridor of images.h, with MIN_FRAMES images at least, and with keyframes among the EARLY
// images after the start. It gets 40 images for its start, and 10 more that it tracks. A line for
// each start, the figures of all at last.
#include "fork/fork.h"
#include "images.h"

#include <dsorb/io/sequence_reader.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

constexpr std::size_t kStartImages = 40;
constexpr std::size_t kTracked = 10;
constexpr double kDegrees = 180 / 3.14159265358979;
constexpr double kMaxDirection = 10;  // [degrees] of a good start
constexpr double kMaxPosition = 0.1;  // error over the way, of a good start that is tracked

struct Sequence {
  dsorb::PinholeCamera camera;
  std::vector<dsorb::FramePtr> frames;
  std::vector<dsorb::SE3> T_world_cam;
};

Sequence corridor() {
  Sequence sequence{{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight}, {}, {}};
  for (int i = 0; i < 33; ++i) {  // then it meets the wall
    const auto pixels = grabImage(i);
    sequence.frames.push_back(dsorb::Frame::create(dsorb::ImageView(pixels.data(), kWidth, kHeight),
                                                   {dsorb::FrameId{i}, i / 30.0}));
    sequence.T_world_cam.emplace_back(Eigen::Quaterniond::Identity(),
                                      Eigen::Vector3d(cameraX(i), 0, cameraZ(i)));
  }
  return sequence;
}

struct StampedPose {
  double time = 0;
  Eigen::Vector3d t{0, 0, 0};
  Eigen::Quaterniond q{1, 0, 0, 0};
};

std::vector<StampedPose> readTruth(const std::string& path) {
  std::ifstream file(path);
  std::vector<StampedPose> truth;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    StampedPose pose;
    Eigen::Vector4d q;
    if (words >> pose.time >> pose.t.x() >> pose.t.y() >> pose.t.z() >> q.x() >> q.y() >> q.z() >>
        q.w()) {
      pose.q = Eigen::Quaterniond(q).normalized();
      truth.push_back(pose);
    }
  }
  if (truth.size() < 2) throw std::runtime_error(path + ": no poses");
  return truth;
}

dsorb::SE3 poseAt(const std::vector<StampedPose>& truth, double time) {
  const auto before = [](const StampedPose& pose, double t) { return pose.time < t; };
  const auto next = std::lower_bound(truth.begin() + 1, truth.end() - 1, time, before);
  const StampedPose &a = *(next - 1), &b = *next;
  const double share = std::clamp((time - a.time) / (b.time - a.time), 0.0, 1.0);
  return {a.q.slerp(share, b.q), a.t + share * (b.t - a.t)};
}

Sequence read(const std::string& path) {
  dsorb::SequenceOptions options;
  options.path = path;
  dsorb::SequenceReader reader(options);
  Sequence sequence{reader.camera(), {}, {}};
  const std::vector<StampedPose> truth = readTruth(path + "/groundtruth.txt");
  while (const auto next = reader.next()) {
    sequence.frames.push_back(next->frame);
    sequence.T_world_cam.push_back(poseAt(truth, next->frame->timestamp()));
  }
  return sequence;
}

struct Outcome {
  std::size_t images = 0;          // given until it started; 0: it did not
  int resets = 0;                  // starts that were refused
  double direction = 0;            // error of the translation between the keyframes [degrees]
  std::optional<double> position;  // error after kTracked images, over the way since the reference
  std::optional<double> early;     // error of the images 10 to 18, aligned by a similarity
};

/// The images as such systems have them: 0 where they show nothing.
std::vector<float> pixelsOf(const dsorb::Frame& frame) {
  const dsorb::PyramidLevel& level = frame.level(0);
  std::vector<float> pixels(level.data(), level.row(level.height()));
  for (float& pixel : pixels) pixel = std::isnan(pixel) ? 0 : pixel;
  return pixels;
}

/// Root mean square error of the images 10 to 18 after `first`, of a system that began with
/// `begin`, its path moved, turned and scaled to the true one.
std::optional<double> earlyError(const Sequence& sequence,
                                 const fork::System& system,
                                 std::size_t begin,
                                 std::size_t first) {
  Eigen::Matrix<double, 3, 9> found, truth;
  for (int k = 0; k < 9; ++k) {
    const std::size_t image = first + 10 + static_cast<std::size_t>(k);
    if (image < begin || !system.history.at(image - begin)->valid) return std::nullopt;
    found.col(k) = system.history[image - begin]->pose.inverse().translation();
    truth.col(k) = sequence.T_world_cam[image].translation();
  }
  const Eigen::Matrix4d T = Eigen::umeyama(found, truth);
  found = (T * found.colwise().homogeneous()).topRows<3>();
  return std::sqrt((found - truth).colwise().squaredNorm().mean());
}

Outcome startAt(const Sequence& sequence, std::size_t first, int min_frames, int early) {
  dsorb::InitializerOptions options;
  options.orb.min_frames = min_frames;
  int refusals = 0;
  std::unique_ptr<fork::System> system;
  Outcome outcome;
  std::size_t i = first, begin = first;
  const std::size_t end = std::min(sequence.frames.size(), first + kStartImages);
  const auto waits = [&] { return !system || system->window.empty(); };
  while (i < end && waits()) {
    if (!system) {
      system = std::make_unique<fork::System>(
          sequence.camera, options, dsorb::DirectStartOptions(), refusals);
      system->early = early;
      begin = i;
    }
    system->addActiveFrame(pixelsOf(*sequence.frames[i++]).data());
    if (!system->init_failed) continue;
    system.reset();
    ++outcome.resets;
  }
  if (waits()) return outcome;
  outcome.images = i - first;
  const fork::Frame& front = *system->window.front();
  const fork::Pose reference = front.pose;
  const auto placed = [&](const fork::Pose& pose) -> Eigen::Vector3d {
    return reference * pose.inverse().translation();
  };
  const std::size_t start = begin + static_cast<std::size_t>(front.shell->number);
  const auto truth = [&](std::size_t k) -> Eigen::Vector3d {
    return (sequence.T_world_cam[start].inverse() * sequence.T_world_cam[k]).translation();
  };
  const Eigen::Vector3d found = placed(system->window.back()->pose), expected = truth(i - 1);
  outcome.direction = kDegrees * std::atan2(found.cross(expected).norm(), found.dot(expected));
  const std::size_t judged = i + kTracked, last = std::max(judged, first + 19);
  if (last > sequence.frames.size()) return outcome;
  double way = expected.norm();
  for (; i < last; ++i) {
    system->addActiveFrame(pixelsOf(*sequence.frames[i]).data());
    if (i < judged) way += (truth(i) - truth(i - 1)).norm();
    if (i + 1 != judged) continue;
    const double scale = expected.norm() / found.norm();
    outcome.position = (scale * placed(system->history.back()->pose) - truth(i)).norm() / way;
  }
  outcome.early = earlyError(sequence, *system, begin, first);
  return outcome;
}

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  std::nth_element(
      values.begin(), values.begin() + static_cast<long>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

void print(const char* what, const std::vector<double>& values) {
  const double largest = values.empty() ? NAN : *std::max_element(values.begin(), values.end());
  std::printf(
      "%s: %.5f (median of %zu), %.5f at most\n", what, median(values), values.size(), largest);
}

/// @return whether all starts were good and stayed so
bool summarise(const std::vector<Outcome>& outcomes) {
  std::vector<double> images, directions, positions, early;
  int good = 0, kept = 0, resets = 0;
  for (const Outcome& outcome : outcomes) {
    resets += outcome.resets;
    if (outcome.images == 0) continue;
    images.push_back(static_cast<double>(outcome.images));
    directions.push_back(outcome.direction);
    good += outcome.direction < kMaxDirection ? 1 : 0;
    if (outcome.early) early.push_back(*outcome.early);
    if (!outcome.position) continue;
    positions.push_back(*outcome.position);
    kept += outcome.direction < kMaxDirection && *outcome.position < kMaxPosition ? 1 : 0;
  }
  if (directions.empty()) return std::puts("no start"), false;
  print("images until the start", images);
  print("error of the direction [degrees]", directions);
  print("error of the position over the way", positions);
  print("error of the images 10 to 18", early);
  std::printf(
      "%zu attempts, %d resets, %zu starts, %d of them less than 10 degrees off; %d of %zu tracked "
      "well\n",
      outcomes.size(),
      resets,
      directions.size(),
      good,
      kept,
      positions.size());
  return directions.size() == outcomes.size() && good == static_cast<int>(directions.size()) &&
         kept == static_cast<int>(positions.size());
}

int run(int argc, char** argv) {
  const Sequence sequence = argc > 1 ? read(argv[1]) : corridor();
  const auto every = static_cast<std::size_t>(argc > 2 ? std::max(1, std::atoi(argv[2])) : 10);
  const int min_frames = argc > 3 ? std::atoi(argv[3]) : 3,
            early = argc > 4 ? std::atoi(argv[4]) : 9;
  std::vector<Outcome> outcomes;
  for (std::size_t first = 0; first + 20 <= sequence.frames.size(); first += every) {
    outcomes.push_back(startAt(sequence, first, min_frames, early));
    const Outcome& outcome = outcomes.back();
    std::printf("image %zu: %zu images, %.2f degrees off, position %.2f %%, images 10 to 18 %.5f\n",
                first,
                outcome.images,
                outcome.direction,
                100 * outcome.position.value_or(NAN),
                outcome.early.value_or(NAN));
  }
  const bool all_good = summarise(outcomes);
  return argc > 1 || all_good ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
