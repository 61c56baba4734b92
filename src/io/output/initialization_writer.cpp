// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/initialization_writer.h"

#include "io/output/run_json.h"

#include <cmath>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace dsorb::io {
namespace {

constexpr std::string_view kHead = "{\n \"initializations\": [";
constexpr int kDepth = 2;  // of an initialization in the file

template <typename Matrix>
Json rows(const Matrix& matrix) {
  Json result = Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    Json row = Json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
    result.push_back(std::move(row));
  }
  return result;
}

Json frameReference(const Frame& frame) {
  return {{"index", frame.id().value}, {"timestamp", frame.timestamp()}};
}

Json poses(const InitializationResult& result) {
  Json list = Json::array();
  for (const PosedFrame& posed : result.frames) {
    const bool known = posed.T_cam_ref && isFinite(*posed.T_cam_ref);
    const bool certain = known && posed.covariance && posed.covariance->allFinite();
    Json entry = frameReference(*posed.frame);
    entry["T_cam_ref"] = known ? rows(posed.T_cam_ref->matrix()) : Json();
    entry["affine"] = {posed.affine.a, posed.affine.b};
    entry["covariance"] = certain ? rows(*posed.covariance) : Json();
    list.push_back(std::move(entry));
  }
  return list;
}

/// Points hosted in the reference as [u, v, inverse depth, variance].
Json referencePoints(const InitializationResult& result) {
  Json list = Json::array();
  for (const InitPoint& point : result.points) {
    if (point.host != 0 || !point.pixel.allFinite() || !std::isfinite(point.inverse_depth) ||
        !std::isfinite(point.variance)) {
      continue;
    }
    list.push_back({shortest(point.pixel.x()),
                    shortest(point.pixel.y()),
                    shortest(point.inverse_depth),
                    shortest(point.variance)});
  }
  return list;
}

/// Names and numbers of what the stages found, in the order in which they run.
class Details {
 public:
  template <typename Number>
  void add(const std::string& name, Number value) {
    json_[name] = static_cast<double>(value);
  }
  template <typename Number>
  void add(const std::string& name, const std::optional<Number>& value) {
    if (value) add(name, *value);
  }
  void add(const TwoViewReport& report);
  void add(const EssentialReport& report);
  void add(const std::string& name, const PhotometricReport& report);
  Json take() { return std::move(json_); }

 private:
  Json json_ = Json::object();
};

void Details::add(const TwoViewReport& report) {
  add("tracks", report.tracks);
  add("score_homography", report.homography_score);
  add("score_fundamental", report.fundamental_score);
  add("model_inliers", report.inliers);
  add("good_points", report.good_points);
  add("good_points_of_second_motion", report.second_good);
  add("ranked_parallax_deg", report.parallax_deg);
  add("removed_severe", report.removed_severe);
  add("removed_normal", report.removed_normal);
}

void Details::add(const EssentialReport& report) {
  add("error_probability", report.gate.error_probability);
  add("plane_probability", report.gate.plane_probability);
  add("second_sigma_deg", report.gate.second_sigma_deg);
  add("misfit", report.gate.misfit);
  add("depth_sigma", report.gate.depth_sigma);
  add("gric_homography_over_essential", report.homography_gric);
  add("second_motion_cost_ratio", report.second_cost);
  add("tracks", report.tracks);
  add("model_inliers", report.inliers);
  add("rotation_residual_px", report.rotation_residual);
  add("direction_sigma_deg", report.gate.direction_sigma_deg);
  add("stuck_tracks", report.stuck_tracks);
  add("front_share", report.front_share);
  add("track_noise", report.track_noise);
  add("refined", report.refinement.accepted);
  add("refine_first_rms", report.refinement.first_rms);
  add("refine_last_rms", report.refinement.last_rms);
  add("refine_turn_deg", report.refinement.direction_change_deg);
  add("variance_factor", report.variance_factor);
  add("clustered_factor", report.clustered_factor);
  if (const auto& readout = report.readout_score) {
    add("readout_score_ms", 1000 * readout->seconds);
    add("readout_score_sigma_ms", 1000 * readout->sigma);
  }
  if (const auto& lens = report.lens_score) {
    add("lens_score_gain", lens->gain);
    add("lens_score_focal_factor", lens->focal_factor);
    add("lens_score_radial", lens->radial);
  }
}

void Details::add(const std::string& name, const PhotometricReport& report) {
  add(name + "_patches", report.patches);
  add(name + "_iterations", report.iterations);
  add(name + "_first_cost", report.first_cost);
  add(name + "_cost", report.cost);
  add(name + "_inside", report.inside_share);
  add(name + "_pose_distance", report.pose_distance);
  add(name + "_poses_moved", report.poses_moved);
}

Json detailsOf(const InitReport& report) {
  Details details;
  if (const auto& direct = report.direct) {
    details.add("residual_rms_grey", direct->residual_rms);
    details.add("visible_share", direct->visible_share);
    details.add("motion_gain", direct->motion_gain);
    details.add("rival_margin", direct->rival_margin);
  }
  if (report.two_view) details.add(*report.two_view);
  if (report.essential) details.add(*report.essential);
  details.add("known_pose_used", report.pose_prior);
  if (const auto& depths = report.depth_prior) {
    details.add("known_depth_used", depths->used);
    details.add("known_depth_contradicted", depths->contradicted);
    details.add("known_depth_corners", depths->corners);
    details.add("known_depth_inflation", depths->inflation);
    details.add("known_depth_sigma", depths->relative_sigma);
  }
  if (const auto& semi_dense = report.semi_dense) {
    details.add("semi_dense_candidates", semi_dense->candidates);
    details.add("semi_dense_points", semi_dense->points);
  }
  if (const auto& dynamic = report.dynamic_regions) {
    details.add("contradicting_tracks", dynamic->contradicting_tracks);
    details.add("removed_dynamic", dynamic->removed);
  }
  if (report.photometric) details.add("photometric", *report.photometric);
  if (const auto& outliers = report.outliers) {
    details.add("filter_examined", outliers->examined);
    details.add("filter_removed_corners", outliers->removed_corners);
    details.add("filter_removed_points", outliers->removed_points);
    details.add("filter_t_scale", outliers->t_scale);
  }
  if (report.second_photometric) details.add("second_photometric", *report.second_photometric);
  details.add("corners", report.corners);
  details.add("optical_flow", report.optical_flow);
  return details.take();
}

Json reportJson(const InitReport& report) {
  Json json = {{"model", report.model},
               {"frames_fed", report.frames_fed},
               {"frames_posed", report.frames_posed},
               {"restarts", report.restarts},
               {"points", report.points},
               {"median_parallax_deg", report.median_parallax_deg},
               {"inlier_ratio", report.inlier_ratio},
               {"residual_rms", report.residual_rms},
               {"median_relative_sigma", report.median_relative_sigma}};
  json["wrong_probability"] =
      report.wrong_probability ? Json(*report.wrong_probability) : Json(nullptr);
  json["earlier_resets"] = Json::array();
  for (const InitReason reason : report.earlier_resets) {
    json["earlier_resets"].push_back(name(reason));
  }
  json["details"] = detailsOf(report);
  return json;
}

void noteRefusal(const std::optional<StartRefusal>& refusal, Json& initialization) {
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

InitializationWriter::InitializationWriter(std::filesystem::path path, std::string initializer)
    : file_(std::move(path), std::string(kHead) + "]\n}\n"),
      initializer_(std::move(initializer)),
      last_begin_(kHead.size()) {}

void InitializationWriter::update(const RunRecord& record, double milliseconds) {
  if (record.estimate()) {
    if (record.estimate()->segment != progress_.segment) {
      progress_ = {};
      progress_.segment = record.estimate()->segment;
    }
    ++progress_.frames_given;
  }
  for (const InitStepNote& step : record.steps()) {
    if (step.status == InitStatus::kRestarted && step.reason != InitReason::kFirstFrame) {
      ++progress_.resets;
      progress_.attempt_milliseconds = 0;
    }
  }
  if (!record.steps().empty()) {
    progress_.total_milliseconds += milliseconds;
    progress_.attempt_milliseconds += milliseconds;
  }
  for (const InitStepNote& step : record.steps()) {
    if (!step.result) continue;
    add(describe(step, milliseconds));
  }
  if (changed_) write();
}

Json InitializationWriter::describe(const InitStepNote& step, double milliseconds) const {
  const InitializationResult& result = *step.result;
  const Frame& reference = *result.frames.front().frame;
  const Frame& target = *result.frames.back().frame;
  Json json;
  json["initializer"] = initializer_;
  json["segment"] = progress_.segment;
  json["frames_given"] = progress_.frames_given;
  json["frames_since_reference"] = std::abs(target.id().value - reference.id().value);
  json["resets"] = progress_.resets;
  noteRefusal(step.refusal, json);
  json["reference"] = frameReference(reference);
  json["target"] = frameReference(target);
  json["camera"] = cameraJson(camera_);
  json["poses"] = poses(result);
  json["points"] = referencePoints(result);
  Json stages = Json::object();
  for (const StageTime& stage : result.report.stages) stages[stage.stage] = stage.milliseconds;
  json["milliseconds"] = {{"total", progress_.total_milliseconds},
                          {"this_attempt", progress_.attempt_milliseconds},
                          {"last_frame", milliseconds},
                          {"stages", std::move(stages)}};
  if (result.metric) {
    json["metric"] = {{"metres_per_unit", result.metric->metres},
                      {"relative_sigma", result.metric->relative_sigma}};
  }
  json["report"] = reportJson(result.report);
  return json;
}

void InitializationWriter::add(Json initialization) {
  if (changed_) write();  // the one before, for the last time
  if (!last_.is_null()) last_begin_ += last_size_;
  last_ = std::move(initialization);
  changed_ = true;
}

void InitializationWriter::write() {
  std::string text = last_begin_ == kHead.size() ? "\n  " : ",\n  ";
  text += jsonText(last_, kDepth);
  last_size_ = text.size();
  file_.replaceEnd(last_begin_, text + "\n ]\n}\n");
  changed_ = false;
}

}  // namespace dsorb::io
