// SPDX-License-Identifier: BSD-3-Clause
// The direct system of direct_system.h started again and again:
//   11_dense_starts [SEQUENCE [EVERY]]
// from every EVERY-th image (default: 10) of a data set with a groundtruth.txt (TUM format), or of
// the corridor of images.h. It gets 40 images for its start and tracks 10 more against its two
// keyframes. A line for each start, the figures of all at last.
#include "direct_system.h"
#include "images.h"

#include <dsorb/io/sequence_reader.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
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
  for (int i = 0; i < 40; ++i) {
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
  double direction = 0;            // error of the translation between the keyframes [degrees]
  std::optional<double> position;  // error after kTracked images, over the way since the reference
};

/// Position of a camera in the reference camera.
Eigen::Vector3d placed(const dsorb::SE3& T_cam_ref) {
  return T_cam_ref.inverse().translation();
}

Outcome startAt(const Sequence& sequence, std::size_t first) {
  direct::DirectSystem system(sequence.camera);
  Outcome outcome;
  std::size_t i = first;
  const std::size_t end = std::min(sequence.frames.size(), first + kStartImages);
  while (i < end && system.keyframes().empty()) system.addActiveFrame(sequence.frames[i++]);
  if (system.keyframes().empty()) return outcome;
  outcome.images = i - first;
  const direct::KeyframeState& newest = system.keyframes().back();
  const auto reference = static_cast<std::size_t>(system.keyframes().front().image->id().value);
  const dsorb::SE3 T_ref_world = sequence.T_world_cam[reference].inverse();
  const auto truth = [&](std::size_t k) -> Eigen::Vector3d {
    return (T_ref_world * sequence.T_world_cam[k]).translation();
  };
  const Eigen::Vector3d found = placed(newest.T_cam_world), expected = truth(i - 1);
  outcome.direction = kDegrees * std::atan2(found.cross(expected).norm(), found.dot(expected));
  if (i + kTracked > sequence.frames.size()) return outcome;
  double way = expected.norm();
  for (std::size_t k = 0; k < kTracked; ++k, ++i) {
    system.addActiveFrame(sequence.frames[i]);
    way += (truth(i) - truth(i - 1)).norm();
  }
  const double scale = expected.norm() / found.norm();
  const Eigen::Vector3d last = scale * placed(system.trajectory().back().T_cam_world);
  outcome.position = (last - truth(i - 1)).norm() / way;
  return outcome;
}

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  std::nth_element(
      values.begin(), values.begin() + static_cast<long>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

/// @return whether all starts were good and stayed so
bool summarise(const std::vector<Outcome>& outcomes) {
  std::vector<double> images, directions, positions;
  int good = 0, kept = 0;
  for (const Outcome& outcome : outcomes) {
    if (outcome.images == 0) continue;
    images.push_back(static_cast<double>(outcome.images));
    directions.push_back(outcome.direction);
    good += outcome.direction < kMaxDirection ? 1 : 0;
    if (!outcome.position) continue;
    positions.push_back(*outcome.position);
    kept += outcome.direction < kMaxDirection && *outcome.position < kMaxPosition ? 1 : 0;
  }
  if (directions.empty()) return std::puts("no start"), false;
  std::printf(
      "%zu attempts, %zu started after %.0f images (median), %d of them less than 10 degrees off; "
      "direction error %.2f degrees (median), %.2f at most; %d of %zu tracked well, position error "
      "%.2f %% of the way (median)\n",
      outcomes.size(),
      directions.size(),
      median(images),
      good,
      median(directions),
      *std::max_element(directions.begin(), directions.end()),
      kept,
      positions.size(),
      100 * median(positions));
  return directions.size() == outcomes.size() && good == static_cast<int>(directions.size()) &&
         kept == static_cast<int>(positions.size());
}

int run(int argc, char** argv) {
  const Sequence sequence = argc > 1 ? read(argv[1]) : corridor();
  const auto every = static_cast<std::size_t>(argc > 2 ? std::max(1, std::atoi(argv[2])) : 10);
  std::vector<Outcome> outcomes;
  for (std::size_t first = 0; first + 20 <= sequence.frames.size(); first += every) {
    outcomes.push_back(startAt(sequence, first));
    const Outcome& outcome = outcomes.back();
    std::printf("image %zu: %zu images, %.2f degrees off, position %.2f %%\n",
                first,
                outcome.images,
                outcome.direction,
                100 * outcome.position.value_or(NAN));
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
