// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/gyroscope.h"

#include "dsorb/error.h"

#include "io/text_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <string>
#include <utility>

namespace dsorb {
namespace {

constexpr double kMostGap = .1;         // between rates that say what was between them [s]
constexpr double kNanoseconds = 1e16;   // times above it are no seconds
constexpr double kNoiseDensity = 5e-3;  // of a telephone's gyroscope, generously [rad/s/sqrt(Hz)]
constexpr double kBias = 1e-2;          // that nobody has calibrated [rad/s]
constexpr double kMostSkewed = 1e-3;    // of a rotation that was typed
constexpr std::size_t kColumns = 4;

std::vector<std::string> wordsOf(std::string text) {
  std::replace(text.begin(), text.end(), ',', ' ');
  return splitWords(text);
}

/// Rates at a time between two samples.
template <typename Sample>
Eigen::Vector3d ratesAt(const Sample& a, const Sample& b, double time) {
  return a.rates + (b.rates - a.rates) * ((time - a.time) / (b.time - a.time));
}

}  // namespace

Gyroscope::Gyroscope(const std::filesystem::path& file, const Eigen::Matrix3d& R_cam_gyro) {
  const std::string expected = "time, wx, wy, wz [s or ns, rad/s]";
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    std::vector<std::string> words = wordsOf(line.text);
    if (samples_.empty() && std::isalpha(static_cast<unsigned char>(words.front().front())) != 0) {
      continue;
    }
    if (words.size() < kColumns) throw line.error("expected " + expected);
    words.resize(kColumns);
    const std::vector<double> n = line.numbers(words, expected);
    const double time = n[0] > kNanoseconds ? n[0] * 1e-9 : n[0];
    if (!samples_.empty() && !(time > samples_.back().time)) {
      throw line.error("its time is not after that of the line before");
    }
    samples_.push_back({time, R_cam_gyro * Eigen::Vector3d(n[1], n[2], n[3])});
  }
  if (samples_.size() < 2) throw lineError(file, 0, "expected two or more lines of " + expected);
}

std::optional<PosePrior> Gyroscope::between(FrameId since, double then, double now) const {
  const double begin = std::min(then, now);
  const double end = std::max(then, now);
  if (begin < samples_.front().time || end > samples_.back().time || !(end > begin)) return {};
  const auto later = std::upper_bound(
      samples_.begin() + 1, samples_.end() - 1, begin, [](double t, const Sample& s) {
        return t < s.time;
      });
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();  // directions of `end` to `begin`
  double time = begin;
  for (auto next = later; time < end; ++next) {
    const Sample& last = *(next - 1);
    if (next->time - last.time > kMostGap) return {};
    const double stop = std::min(end, next->time);
    turn = turn * so3Exp(ratesAt(last, *next, (time + stop) / 2) * (stop - time));
    time = stop;
  }
  const Eigen::Quaterniond now_from_then = then < now ? turn.conjugate() : turn;
  const double duration = end - begin;
  const double sigma = std::hypot(kNoiseDensity * std::sqrt(duration), kBias * duration);
  return rotationSince(since, now_from_then.toRotationMatrix(), sigma);
}

std::optional<Eigen::Matrix3d> parseRotation(const std::string& text) {
  const std::vector<std::string> words = wordsOf(text);
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R;
  if (words.size() != 9) return {};
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (!parseNumber(words[i], R.data()[i])) return {};
  }
  const bool rotation =
      (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < kMostSkewed && R.determinant() > 0;
  return rotation ? std::optional<Eigen::Matrix3d>(R) : std::nullopt;
}

}  // namespace dsorb
